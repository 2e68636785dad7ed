//! The command line: arguments in, a library call, a summary out. It holds no algorithm.

mod checkpoints;
mod failure;
mod interrupt;
mod products;
mod run_folder;
mod run_lock;
mod stage;
mod ui;

mod align;
mod ba;
mod dsm;
mod dsm_eval;
mod info;
mod nvs_eval;
mod render;
mod report;
mod rpc;
mod run;
mod scene_args;
mod simulate;
mod train;

use clap::{Parser, Subcommand};
pub use failure::Failure;
pub use scene_args::SceneArgs;
pub use ui::Ui;

/// From a few satellite images with RPC cameras to a georeferenced surface model, an orthophoto, corrected
/// cameras and a Gaussian-splat model.
///
/// `satgs run SCENE -o RUN` does everything in a row; the other commands are its stages.
#[derive(Parser)]
#[command(
    name = "satgs",
    version,
    max_term_width = 100,
    after_help = "\
Exit codes: 0 complete, 1 failed, 2 input or usage wrong, 3 partial, 130 interrupted."
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    common: Common,
}

/// Options of every command.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct Common {
    /// Print a machine-readable summary (one JSON object) on standard output
    #[arg(long, global = true)]
    json: bool,
    /// Say more: stages and timings (-v), details (-vv)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Threads to use [default: all cores]; results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Subcommand)]
enum Command {
    Simulate(simulate::Args),
    Info(info::Args),
    Rpc(rpc::Args),
    Ba(ba::Args),
    Align(align::Args),
    Train(train::Args),
    Dsm(dsm::Args),
    DsmEval(dsm_eval::Args),
    Render(render::Args),
    NvsEval(nvs_eval::Args),
    Run(Box<run::Args>),
    Report(report::Args),
}

/// Parses the command line, runs one command, reports its failure.
#[must_use]
pub fn main() -> std::process::ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(e) => {
            // Help and version are no errors; clap prints each to its own stream and knows its exit code.
            let code = e.exit_code();
            let printed = e.print().or_else(ui::output_lost);
            if printed.is_err() && code == 0 {
                return std::process::ExitCode::FAILURE;
            }
            return std::process::ExitCode::from(u8::try_from(code).unwrap_or(2));
        }
    };
    let ui = Ui::new(&cli.common);
    let result = ui.set_up().and_then(|()| match &cli.command {
        Command::Simulate(args) => simulate::run(args, &ui),
        Command::Info(args) => info::run(args, &ui),
        Command::Rpc(args) => rpc::run(args, &ui),
        Command::Ba(args) => ba::run(args, &ui),
        Command::Align(args) => align::run(args, &ui),
        Command::Train(args) => train::run(args, &ui),
        Command::Dsm(args) => dsm::run(args, &ui),
        Command::DsmEval(args) => dsm_eval::run(args, &ui),
        Command::Render(args) => render::run(args, &ui),
        Command::NvsEval(args) => nvs_eval::run(args, &ui),
        Command::Run(args) => run::run(args, &ui),
        Command::Report(args) => report::run(args, &ui),
    });
    if result.as_ref().err().is_none_or(Failure::is_partial) {
        ui.finish_json();
    }
    run_lock::release();
    let lost = ui.require_output();
    // A part that is missing is told too, but what is lost decides the exit code; other failures come first.
    let failures = [result.err(), lost.err()].into_iter().flatten().collect::<Vec<_>>();
    failures.iter().for_each(|failure| ui.report(failure));
    let decides = failures.iter().find(|failure| !failure.is_partial()).or(failures.first());
    decides.map_or(std::process::ExitCode::SUCCESS, |failure| std::process::ExitCode::from(failure.exit_code))
}

/// A length above 0.
fn parse_metres(text: &str) -> Result<f64, String> {
    let metres = text.parse().ok().filter(|m: &f64| m.is_finite() && *m > 0.0);
    metres.ok_or_else(|| format!("`{text}` is no number of metres above 0"))
}
