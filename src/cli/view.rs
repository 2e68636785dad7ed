//! `satgs view`: a run in the browser.

use super::{CliError, Ui, ending};
use crate::pipeline::{serve_live_page, serve_page, write_page};
use std::path::PathBuf;
use std::process::{Command, Stdio};

/// Show a run in the browser: splats, mesh, surface model, sparse points and cameras
///
/// On the page you can turn the scene, switch layers, read map coordinates under the pointer, measure between two points and see
/// the profile of heights between them. It is served only to this machine, until Ctrl-C; nothing is loaded from the network. With
/// --html it is one file, which opens without satgs.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    /// Run folder of `satgs train`, or of a tile
    run: PathBuf,
    /// Compare with this run by a divider that is moved across the picture
    #[arg(long, value_name = "RUN2")]
    compare: Option<PathBuf>,
    /// Watch a run that trains: the splats of every checkpoint, with iteration and loss
    #[arg(long, conflicts_with_all = ["html", "compare"])]
    live: bool,
    /// Write the page to this file (.html) instead of serving it
    #[arg(long, value_name = "FILE", value_parser = ending(&["html", "htm"]))]
    html: Option<PathBuf>,
    /// Replace the file if it exists
    #[arg(long, requires = "html")]
    overwrite: bool,
    /// Serve on this port of 127.0.0.1 [default: a free one]
    #[arg(long, value_name = "N", conflicts_with = "html", value_parser = clap::value_parser!(u16).range(1..))]
    port: Option<u16>,
    /// Do not open a browser: only print the address
    #[arg(long, conflicts_with = "html")]
    no_open: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    if let Some(file) = &args.html {
        let page = write_page(&args.run, args.compare.as_deref(), file, args.overwrite)?;
        let megabytes = page.bytes as f64 / 1e6;
        let text = format!("{}, {megabytes:.1} MB: {}", page.page.display(), page.layers.join(", "));
        return ui.summary("view", Some(&text), &page);
    }
    let started = |address: &str| {
        ui.print_line(&format!("{address} until Ctrl-C"));
        if !args.no_open {
            open(address);
        }
        Ok(())
    };
    if args.live {
        return Ok(serve_live_page(&args.run, args.port, started, ui)?);
    }
    Ok(serve_page(&args.run, args.compare.as_deref(), args.port, started, ui)?)
}

/// Opens an address in the user's browser. Where this is not possible, the address is on the terminal.
fn open(address: &str) {
    let (program, first): (_, &[&str]) = match std::env::consts::OS {
        "macos" => ("open", &[]),
        "windows" => ("cmd", &["/C", "start"]),
        _ => ("xdg-open", &[]),
    };
    let mut command = Command::new(program);
    command.args(first).arg(address).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _ = command.spawn();
}
