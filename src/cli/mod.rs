//! The command line: arguments in, a library call, a summary out. It holds no algorithm.

mod called;
mod changes;
mod error;
mod event_lines;
mod interrupt;
mod ui;

mod align;
mod ba;
#[cfg_attr(not(feature = "gpu"), path = "no_device_info.rs")]
mod device_info;
mod dsm;
mod dsm_eval;
mod export;
mod info;
mod learn;
mod mesh;
mod mesh_eval;
mod mosaic;
mod nvs_eval;
mod perspective_args;
mod perspective_info;
mod plan;
mod predict;
mod prior;
mod render;
mod report;
mod rpc;
mod run;
mod scene_args;
mod scene_kind;
mod simulate;
mod splat_info;
mod tile;
mod train;
mod view;

pub use called::{arguments, call, read_scene};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
pub use error::{CliError, ExitStatus};
pub use perspective_args::PerspectiveArgs;
pub use scene_args::SceneArgs;
use std::ffi::OsString;
use std::path::PathBuf;
pub use ui::{StageSummary, Ui};

/// Make a digital surface model, an orthophoto, corrected cameras and a Gaussian-splat model from satellite images with RPC
/// cameras; a Gaussian-splat model and a mesh from photographs with known poses.
///
/// `satgs run SCENE -o RUN` runs all stages; the other commands are single stages, and tools.
#[derive(Parser)]
#[command(
    name = "satgs",
    version,
    disable_help_flag = true,
    disable_version_flag = true,
    max_term_width = 100,
    after_help = "\
Exit codes: 0 complete, 1 failed, 2 wrong input or usage, 3 partly complete, 75 too little memory or
disk, 130 interrupted."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
    /// Print the version
    #[arg(short = 'V', long, action = clap::ArgAction::Version, help_heading = FOR_ALL)]
    version: Option<bool>,
}

/// Heading of the options of every command, which stand last in the help.
const FOR_ALL: &str = "Options of all commands";

/// Options of every command.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Common {
    /// Print the summary as one JSON object on standard output
    #[arg(long, global = true, help_heading = FOR_ALL)]
    json: bool,
    /// Print each progress event as a line of JSON on standard output, and the summary as the last line
    #[arg(long, global = true, conflicts_with = "json", help_heading = FOR_ALL, hide_short_help = true)]
    events: bool,
    /// Print more: stages and timings (-v), details (-vv)
    #[arg(short, long, global = true, action = clap::ArgAction::Count, help_heading = FOR_ALL)]
    verbose: u8,
    /// Print errors only
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = FOR_ALL)]
    quiet: bool,
    /// Number of threads, on which results do not depend [default: number of processor cores]
    #[arg(long, global = true, help_heading = FOR_ALL, hide_short_help = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print the common options (-h), or all options with details (--help)
    #[arg(short, long, global = true, action = clap::ArgAction::Help, help_heading = FOR_ALL)]
    help: Option<bool>,
}

#[derive(Subcommand)]
enum Command {
    // In the order of the help, as in README.md.
    Info(info::Args),
    Run(Box<run::Args>),
    #[command(mut_arg("scene", scene_args::of_satellites))]
    Ba(ba::Args),
    Train(train::Args),
    Dsm(dsm::Args),
    DsmEval(dsm_eval::Args),
    Changes(changes::Args),
    Report(report::Args),
    Align(align::Args),
    Rpc(rpc::Args),
    View(view::Args),
    Render(render::Args),
    NvsEval(nvs_eval::Args),
    Mesh(mesh::Args),
    MeshEval(mesh_eval::Args),
    Export(export::Args),
    #[command(mut_arg("scene", scene_args::of_satellites))]
    Plan(Box<plan::Args>),
    Tile(tile::Args),
    Mosaic(mosaic::Args),
    Predict(predict::Args),
    Learn(learn::Args),
    Prior(prior::Args),
    Simulate(simulate::Args),
}

/// The command line with all commands and options, for completions and man pages.
#[must_use]
pub fn program() -> clap::Command {
    Cli::command()
}

/// Runs the command line of this process.
#[must_use]
pub fn main() -> std::process::ExitCode {
    std::process::ExitCode::from(run_command_line(std::env::args_os()))
}

/// Parses a command line, whose first word is the program's name, runs one command, reports its error; returns the exit
/// code.
#[must_use]
pub fn run_command_line(words: impl IntoIterator<Item = OsString>) -> u8 {
    let (cli, given) = match parse(words) {
        Ok(parsed) => parsed,
        Err(e) => {
            // Help and version are no errors; clap prints each to its own stream and knows its exit code.
            let code = e.exit_code();
            let printed = e.print().or_else(ui::output_lost);
            if printed.is_err() && code == 0 {
                return ExitStatus::Failed as u8;
            }
            return u8::try_from(code).unwrap_or(ExitStatus::WrongInput as u8);
        }
    };
    let ui = Ui::new(&cli.common, given, None);
    let result = ui.set_up().and_then(|()| run(&cli.command, &ui));
    if result.as_ref().err().is_none_or(CliError::is_partial) {
        ui.finish_json();
    }
    let lost = ui.require_output();
    // A part that is missing is told too, but what is lost decides the exit code; other failures come first.
    let errors = [result.err(), lost.err()].into_iter().flatten().collect::<Vec<_>>();
    errors.iter().for_each(|error| ui.report(error));
    let decides = errors.iter().find(|error| !error.is_partial()).or(errors.first());
    decides.map_or(0, |error| error.status as u8)
}

/// Parses a command line, whose first word is the program's name.
fn parse(words: impl IntoIterator<Item = OsString>) -> Result<(Cli, scene_kind::Given), clap::Error> {
    let mut program = program();
    let matches = program.try_get_matches_from_mut(words)?;
    let cli = Cli::from_arg_matches(&matches).map_err(|e| e.format(&mut program))?;
    Ok((cli, scene_kind::Given::of(&program, &matches)))
}

/// Runs a command.
fn run(command: &Command, ui: &Ui) -> Result<(), CliError> {
    match command {
        Command::Simulate(args) => simulate::run(args, ui),
        Command::Info(args) => info::run(args, ui),
        Command::Rpc(args) => rpc::run(args, ui),
        Command::Ba(args) => ba::run(args, ui),
        Command::Align(args) => align::run(args, ui),
        Command::Train(args) => train::run(args, ui),
        Command::Dsm(args) => dsm::run(args, ui),
        Command::DsmEval(args) => dsm_eval::run(args, ui),
        Command::Changes(args) => changes::run(args, ui),
        Command::Render(args) => render::run(args, ui),
        Command::NvsEval(args) => nvs_eval::run(args, ui),
        Command::Mesh(args) => mesh::run(args, ui),
        Command::MeshEval(args) => mesh_eval::run(args, ui),
        Command::Prior(args) => prior::run(args, ui),
        Command::Predict(args) => predict::run(args, ui),
        Command::Learn(args) => learn::run(args, ui),
        Command::Run(args) => run::run(args, ui),
        Command::Plan(args) => plan::run(args, ui),
        Command::Tile(args) => tile::run(args, ui),
        Command::Mosaic(args) => mosaic::run(args, ui),
        Command::Report(args) => report::run(args, ui),
        Command::View(args) => view::run(args, ui),
        Command::Export(args) => export::run(args, ui),
    }
}

/// A length above 0.
fn parse_metres(text: &str) -> Result<f64, String> {
    let metres = text.parse().ok().filter(|m: &f64| m.is_finite() && *m > 0.0);
    metres.ok_or_else(|| "expected metres, a number above 0".to_owned())
}

/// Accepts the names of values, which the help lists with what they are.
fn named<T: Copy + Send + Sync + 'static>(
    all: &'static [(T, &'static str, &'static str)],
) -> impl TypedValueParser<Value = T> {
    let names = all.iter().map(|(_, name, what)| PossibleValue::new(*name).help(*what));
    PossibleValuesParser::new(names).try_map(move |given| {
        let found = all.iter().find(|(_, name, _)| *name == given);
        found.map(|(value, ..)| *value).ok_or_else(|| format!("`{given}` is none of the values"))
    })
}

/// A summary as JSON.
fn json(value: &impl serde::Serialize) -> Result<serde_json::Value, CliError> {
    serde_json::to_value(value)
        .map_err(|e| CliError::failed(format!("the summary cannot be written as JSON: {e}")))
}

/// Accepts paths with one of these endings.
fn ending(
    allowed: &'static [&'static str],
) -> impl Fn(&str) -> Result<PathBuf, String> + Clone + Send + Sync + 'static {
    move |text| {
        let path = PathBuf::from(text);
        let found = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        match found {
            Some(e) if allowed.contains(&e.as_str()) => Ok(path),
            _ => Err(format!("expected a file that ends in .{}", allowed.join(" or ."))),
        }
    }
}
