//! `satgs tile`: the jobs of a plan, one at a time.

use super::plan::duration;
use super::{CliError, Ui, interrupt};
use crate::pipeline::Outcome;
use crate::progress::Progress;
use crate::tiles::{Blended, Done, Plan, Status, TileState, blend, run_tile, status};
use clap::Subcommand;
use std::fmt::Write;
use std::path::PathBuf;

/// Make one tile of a plan: the jobs of a cluster
///
/// `satgs plan` writes the plan. Every job can be repeated: what is done is kept, an interrupted job continues from its
/// checkpoint, and the results depend on the plan alone. Exit codes: 0 done; 1 failed, try again; 2 wrong input, do not try
/// again; 75 too little memory or disk, try a larger machine; 130 interrupted, try again.
#[derive(clap::Args)]
pub struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Train and render one tile: writes RUN/tiles/ID
    Run(RunArgs),
    /// Blend one tile with its neighbours, which must be done: writes RUN/mosaic/ID_*.tif
    Blend(BlendArgs),
    /// Show which tiles are done, running, planned or failed
    Status(StatusArgs),
}

/// A tile of a plan.
#[derive(clap::Args, Clone, Debug)]
struct TileArgs {
    /// Run folder of `satgs plan`
    run: PathBuf,
    /// ID of the tile, as in RUN/tiles.json
    #[arg(required_unless_present = "index")]
    id: Option<String>,
    /// Number of the tile in RUN/tiles.json, counted from 0, for job arrays
    #[arg(long, value_name = "N", conflicts_with = "id")]
    index: Option<usize>,
    #[command(flatten)]
    job: JobArgs,
}

/// How a job is supervised.
#[derive(clap::Args, Clone, Debug)]
pub struct JobArgs {
    /// Stop when standard input is closed, so that the job does not outlive the program that started it
    #[arg(long)]
    exit_with_parent: bool,
}

#[derive(clap::Args, Clone, Debug)]
struct RunArgs {
    #[command(flatten)]
    tile: TileArgs,
    /// Iterations between checkpoints; an interrupted training continues from the last one
    #[arg(long, default_value_t = 500, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    checkpoint_every: u32,
}

#[derive(clap::Args, Clone, Debug)]
struct BlendArgs {
    #[command(flatten)]
    tile: TileArgs,
    /// ID of a neighbour that failed: blend without it; repeatable
    #[arg(long, value_name = "ID")]
    without: Vec<String>,
}

#[derive(clap::Args, Clone, Debug)]
struct StatusArgs {
    /// Run folder of `satgs plan`
    run: PathBuf,
}

impl TileArgs {
    fn id(&self) -> Result<String, CliError> {
        let Some(index) = self.index else { return Ok(self.id.clone().unwrap_or_default()) };
        let plan = Plan::read(&self.run)?;
        let tile = plan.tiles.get(index).ok_or_else(|| {
            let message = format!("--index {index}: the plan has {} tiles", plan.tiles.len());
            CliError::input(message, "tiles are counted from 0")
        })?;
        Ok(tile.id.clone())
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    match &args.command {
        Command::Run(args) => {
            let id = args.tile.id()?;
            let job =
                |progress: &dyn Progress| Ok(run_tile(&args.tile.run, &id, args.checkpoint_every, progress)?);
            let text = |done: &Done| {
                let memory =
                    done.peak_memory_mb.map_or_else(String::new, |mb| format!(", {:.1} GB", mb / 1e3));
                format!("tile {id}: {} splats in {}{memory}", done.splats, duration(done.seconds))
            };
            args.tile.job.supervised(ui, "tile", job, text).map(|_| ())
        }
        Command::Blend(args) => {
            let id = args.tile.id()?;
            let job = |progress: &dyn Progress| Ok(blend(&args.tile.run, &id, &args.without, progress)?);
            let text = |blended: &Blended| format!("tile {id}: blended along {} seams", blended.seams.len());
            args.tile.job.supervised(ui, "blend", job, text).map(|_| ())
        }
        Command::Status(args) => {
            let status = status(&args.run)?;
            ui.summary("status", Some(&table(&status)), &status)
        }
    }
}

impl JobArgs {
    /// Runs a job and shows its summary.
    pub fn supervised<T: serde::Serialize>(
        &self,
        ui: &Ui,
        name: &str,
        job: impl FnOnce(&dyn Progress) -> Result<Outcome<T>, CliError>,
        text: impl Fn(&T) -> String,
    ) -> Result<Outcome<T>, CliError> {
        if self.exit_with_parent {
            interrupt::stop_with_parent();
        }
        let outcome = job(ui)?;
        ui.outcome(name, &outcome, text)?;
        Ok(outcome)
    }
}

fn table(status: &Status) -> String {
    let Status { planned, running, done, failed, .. } = status;
    let mut out = format!("{done} done, {running} running, {planned} planned, {failed} failed");
    if status.seconds_left > 0.0 {
        let _ = write!(out, "; predicted time left, one after the other: {}", duration(status.seconds_left));
    }
    for tile in &status.tiles {
        let state = match tile.state {
            TileState::Planned => "planned",
            TileState::Running => "running",
            TileState::Done => "done",
            TileState::Failed => "failed",
        };
        let _ = write!(out, "\n{}  {state:<8}", tile.id);
        if let Some(seconds) = tile.seconds {
            let _ = write!(out, " {:>10}", duration(seconds));
        }
        if let Some(mb) = tile.peak_memory_mb {
            let _ = write!(out, "  {:.1} GB", mb / 1e3);
        }
        if let Some(reason) = &tile.reason {
            let _ = write!(out, " {reason}");
        }
    }
    out
}
