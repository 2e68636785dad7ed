//! `satgs run`: every stage in a row.

use super::{CliError, Ui, ba, dsm, dsm_eval, mosaic, plan, report, train};
use crate::bundle::LeftOut;
use crate::pipeline::{RunOptions, StageResult};
use crate::tiles::{SceneOptions, SceneResult, run as run_all};
use std::path::PathBuf;

/// Do everything: adjust, train, render, score if --truth is given, and write a report
///
/// Stages that RUN holds already, made from the same input and options, are kept: the same command continues an
/// interrupted run where it stopped. An area larger than --core is cut into tiles, which are made one after the other and
/// blended: RUN/tiles, RUN/mosaic and RUN/seams.gpkg are added then.
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
    /// Score dsm.tif against this surface model (any GDAL raster, DFC2019's .tif with its .txt) or point cloud (.las, .laz)
    #[arg(long, value_name = "DSM")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scoring: dsm_eval::TruthOptionArgs,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let (run, overwrite) = (args.ba.output(), args.ba.overwrite());
    let stages = RunOptions {
        adjust: args.ba.options(),
        train: args.training.options(overwrite),
        dsm: args.surface.options(overwrite),
        truth: args.truth.clone(),
        evaluate: args.scoring.options(true),
    };
    let options = SceneOptions {
        stages,
        core_m: args.tiling.core,
        overlap_m: args.tiling.overlap,
        max_memory_mb: args.tiling.max_memory,
    };
    // Files that late stages read are opened before the images: training is long.
    options.check(run)?;
    let scene = args.ba.read_scene(ui)?;
    let mut left_out: Vec<LeftOut> = Vec::new();
    let mut shown = Ok(());
    let mut show = |result: SceneResult| {
        let done = match result {
            SceneResult::Planned(outcome) => plan::show(run, &outcome, ui),
            SceneResult::Mosaicked(outcome) => mosaic::show(run, &outcome, ui),
            SceneResult::Stage(StageResult::Adjusted(adjusted)) => {
                left_out = adjusted.left_out().to_vec();
                ba::show(&adjusted, ui)
            }
            SceneResult::Stage(StageResult::Trained(outcome)) => train::show(run, &outcome, ui),
            SceneResult::Stage(StageResult::Dsm(outcome)) => dsm::show(run, &outcome, ui),
            SceneResult::Stage(StageResult::Evaluated(evaluation)) => dsm_eval::show(&evaluation, ui),
            SceneResult::Stage(StageResult::Reported(page)) => report::show(&page, ui),
        };
        if shown.is_ok() {
            shown = done;
        }
    };
    run_all(&scene, &options, run, ui, &mut show)?;
    shown?;
    ba::require_all(run, &left_out)
}
