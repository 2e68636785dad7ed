//! `satgs run`: every stage in a row.

use super::perspective_args::PerspectiveArgs;
use super::scene_kind::SceneKind;
use super::{CliError, Ui, ba, dsm, dsm_eval, mosaic, nvs_eval, plan, report, train};
use crate::bundle::LeftOut;
use crate::perspective::PerspectiveScene;
use crate::pipeline::{PerspectiveRunOptions, RunOptions, StageResult, run_perspective};
use crate::splat::recipe::Recipe;
use crate::tiles::{SceneOptions, SceneResult, run as run_all};
use std::path::{Path, PathBuf};

/// Do everything: adjust, train, render, score if --truth is given, and write a report
///
/// Stages in RUN that were made from the same input and options are kept: the same command continues an interrupted run. An area
/// larger than --core is cut into tiles, which are made one after the other and blended (RUN/tiles, RUN/mosaic,
/// RUN/seams.gpkg).
///
/// A perspective scene (a COLMAP project, transforms.json, RGB-D frames, LEVIR-NVS, ScanNet++) is trained with recipe `3dgs`,
/// held-back views are scored, and with --georef a surface model is made.
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
    /// Any GDAL raster, DFC2019's .tif with its .txt, or points (.las, .laz).
    #[arg(long, value_name = "DSM", help_heading = "Scoring")]
    truth: Option<PathBuf>,
    #[command(flatten)]
    scoring: dsm_eval::TruthOptionArgs,
    #[command(flatten)]
    perspective: PerspectiveArgs,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let (run, overwrite) = (args.ba.output(), args.ba.overwrite());
    if PerspectiveScene::is_one(args.ba.scene()) {
        return run_photographs(args, ui);
    }
    ui.given().require_of(SceneKind::Satellites, args.ba.scene())?;
    let stages = RunOptions {
        adjust: args.ba.options(),
        train: args.training.options(Recipe::NAMES[0], overwrite),
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
            SceneResult::Stage(result) => show_stage(run, &result, ui),
        };
        if shown.is_ok() {
            shown = done;
        }
    };
    run_all(&scene, &options, run, ui, &mut show)?;
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
        StageResult::Evaluated(evaluation) => dsm_eval::show(evaluation, ui),
        StageResult::Reported(page) => report::show(page, ui),
    }
}

/// Runs the stages of a perspective scene.
fn run_photographs(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let (run, overwrite) = (args.ba.output(), args.ba.overwrite());
    ui.given().require_of(SceneKind::Photographs, args.ba.scene())?;
    ba::refuse_output_inside(run, args.ba.scene())?;
    let options = PerspectiveRunOptions {
        scene: args.perspective.options(),
        train: args.training.options(Recipe::OF_PERSPECTIVE_SCENES, overwrite),
        dsm: args.surface.options(overwrite),
    };
    let mut shown = Ok(());
    let mut show = |result: StageResult| {
        let done = show_stage(run, &result, ui);
        if shown.is_ok() {
            shown = done;
        }
    };
    run_perspective(args.ba.scene(), &options, run, ui, &mut show)?;
    shown
}
