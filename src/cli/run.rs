//! `satgs run`: every stage in a row.

use super::perspective_args::PerspectiveArgs;
use super::{CliError, Ui, ba, dsm, dsm_eval, mosaic, nvs_eval, plan, report, train};
use crate::bundle::LeftOut;
use crate::run::{RunOptions, StageResult, run as run_all};
use crate::splat::recipe::Recipe;
use std::path::{Path, PathBuf};

/// Run all stages: adjust, train, render, score if --truth is given, and write a report
///
/// Stages in RUN that were made from the same input and options are kept: the same command continues an interrupted run. An area
/// with a side of more than 1.5 times --core is cut into tiles, which are trained one after the other and blended (RUN/tiles,
/// RUN/mosaic, RUN/seams.gpkg).
///
/// Photographs are trained with recipe `3dgs`, without adjustment; held-back views are scored, and with --georef a surface
/// model is rendered.
#[derive(clap::Args, Clone, Debug)]
pub struct Args {
    #[command(flatten)]
    ba: ba::Args,
    #[command(flatten)]
    training: train::Options,
    #[command(flatten)]
    surface: dsm::Options,
    #[command(flatten)]
    tiling: plan::Options,
    /// Score dsm.tif against this surface model or point cloud
    ///
    /// A raster in a projected CRS in metres, DFC2019's .tif with its .txt, or points (.las, .laz).
    #[arg(long, value_name = "DSM", help_heading = "Scoring")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scoring: dsm_eval::TruthOptionArgs,
    #[command(flatten)]
    perspective: PerspectiveArgs,
}

impl Args {
    fn options(&self) -> RunOptions {
        let overwrite = self.ba.overwrite();
        let recipe =
            if self.ba.is_of_photographs() { Recipe::OF_PERSPECTIVE_SCENES } else { Recipe::NAMES[0] };
        RunOptions {
            adjust: self.ba.options(),
            train: self.training.options(recipe, overwrite),
            dsm: self.surface.options(overwrite),
            truth: self.truth.clone(),
            evaluate: self.scoring.options(true),
            core_m: self.tiling.core,
            overlap_m: self.tiling.overlap,
            max_memory_mb: self.tiling.max_memory,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let (run, options) = (args.ba.output(), args.options());
    if !args.ba.is_of_photographs() {
        // Files that late stages read are opened before the images: training is long.
        options.check_satellites(run)?;
    }
    let scene = args.ba.read_any(&args.perspective, ui)?;
    let mut left_out: Vec<LeftOut> = Vec::new();
    let mut shown = Ok(());
    let mut show = |result: StageResult| {
        if let StageResult::Adjusted(adjusted) = &result {
            left_out = adjusted.left_out().to_vec();
        }
        let done = show_stage(run, &result, ui);
        if shown.is_ok() {
            shown = done;
        }
    };
    run_all(scene, &options, run, ui, &mut show)?;
    shown?;
    ba::require_all(run, &left_out, ui)
}

/// Shows the summary of a stage.
fn show_stage(run: &Path, result: &StageResult, ui: &Ui) -> Result<(), CliError> {
    match result {
        StageResult::Adjusted(adjusted) => ba::show(adjusted, ui),
        StageResult::Trained(outcome) => train::show(run, outcome, ui),
        StageResult::Scored(scores) => nvs_eval::show(scores, ui),
        StageResult::Dsm(outcome) => dsm::show(run, outcome, ui),
        StageResult::Planned(outcome) => plan::show(run, outcome, ui),
        StageResult::Mosaicked(outcome) => mosaic::show(run, outcome, ui),
        StageResult::Evaluated(evaluation) => dsm_eval::show(evaluation, ui),
        StageResult::Reported(page) => report::show(page, ui),
    }
}
