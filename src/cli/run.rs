//! `satgs run`: every stage in a row.

use super::{Failure, Ui, ba, dsm, dsm_eval, report, train};
use crate::metrics::Truth;
use crate::run_files::{DSM, EVALUATION};
use std::path::PathBuf;

/// Everything in a row: adjust, train, render, score if there is a truth, and a page that shows it all
///
/// What RUN already holds of the same input and options is kept, so that an interrupted run goes on where it was.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    ba: ba::Args,
    #[command(flatten)]
    training: train::Options,
    #[command(flatten)]
    surface: dsm::Options,
    /// Score dsm.tif against this surface model (any GDAL raster, DFC2019's .tif with its .txt, or .las, .laz)
    #[arg(long, value_name = "DSM")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scoring: dsm_eval::TruthOptionArgs,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    // What late stages read is opened first: training is long.
    args.training.recipe()?;
    args.surface.check(args.ba.output())?;
    let options = args.scoring.options()?;
    if let Some(truth) = &args.truth {
        Truth::check(truth, &options)?;
    }
    let (run, overwrite) = (args.ba.output(), args.ba.overwrite());
    let left_out = ba::adjust_run(&args.ba, ui)?;
    train::train_run(run, &args.training, overwrite, ui)?;
    dsm::render_run(run, &args.surface, overwrite, ui)?;
    if let Some(truth) = &args.truth {
        dsm_eval::score(&run.join(DSM), truth, &options, Some(&run.join(EVALUATION)), ui)?;
    }
    report::write(run, ui)?;
    ba::require_all(run, &left_out)
}
