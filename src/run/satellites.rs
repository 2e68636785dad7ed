//! All stages of a satellite scene, as a whole or by tiles.

use super::{RunError, RunOptions, StageResult};
use crate::pipeline::{
    ErrorKind, EvaluateOptions, KnownSurface, PipelineError, RunLock, adjust_locked, dsm_locked, evaluate,
    report, surface_before_training, train_locked,
};
use crate::progress::{Event, Progress};
use crate::run_files::{DSM, EVALUATION, PLAN};
use crate::scene::Scene;
use crate::tiles::{self, Plan, TilesError, mosaic_locked, needs_tiles, plan_locked, run_tile};
use std::path::Path;

/// Adjusts a scene, makes its surface, scores it if there is a truth, and writes a report.
pub fn run(
    scene: &Scene,
    options: &RunOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), RunError> {
    options.check_satellites(run)?;
    let _lock = RunLock::make(run)?;
    completed(StageResult::Adjusted(adjust_locked(scene, &options.adjust, run, progress)?));
    if !run.join(PLAN).exists() && !needs_tiles(run, &options.planning())? {
        make_whole(run, options, progress, completed)?;
        score(run, options, progress, completed)?;
        completed(StageResult::Reported(report(run)?));
        return Ok(());
    }
    options.require_options_of_tiles()?;
    let failed = make_by_tiles(run, options, progress, completed)?;
    score(run, options, progress, completed)?;
    completed(StageResult::Reported(tiles::report(run)?));
    if failed.is_empty() { Ok(()) } else { Err(TilesError::Partial { failed: failed.join(", ") }.into()) }
}

/// Trains the area as a whole and renders its surface model.
fn make_whole(
    run: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), PipelineError> {
    let mut surface_is_known =
        |known: KnownSurface| surface_before_training(run, &options.dsm, &known, progress);
    let trained = train_locked(run, &options.train, progress, &mut surface_is_known)?;
    completed(StageResult::Trained(trained));
    completed(StageResult::Dsm(dsm_locked(run, &options.dsm, progress)?));
    Ok(())
}

/// Plans tiles, makes them, blends them, and returns the IDs of those that failed.
fn make_by_tiles(
    run: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<Vec<String>, TilesError> {
    let planned = plan_locked(run, &options.planning(), progress)?;
    let plan = Plan::read(run)?;
    completed(StageResult::Planned(planned));
    let failed = make_tiles(run, &plan, options.train.checkpoint_every, progress)?;
    completed(StageResult::Mosaicked(mosaic_locked(run, progress)?));
    Ok(failed)
}

/// Makes all tiles, one after the other, and returns the IDs of those that failed.
fn make_tiles(
    run: &Path,
    plan: &Plan,
    checkpoint_every: u32,
    progress: &dyn Progress,
) -> Result<Vec<String>, TilesError> {
    let (mut failed, mut first) = (Vec::new(), None);
    for (i, tile) in plan.tiles.iter().enumerate() {
        progress.check().map_err(PipelineError::from)?;
        progress.event(Event::Note(format!("tile {} of {}: {}", i + 1, plan.tiles.len(), tile.id)));
        match run_tile(run, &tile.id, checkpoint_every, progress) {
            Ok(_) => {}
            Err(e) if e.kind() == ErrorKind::Interrupted => return Err(e),
            Err(e) => {
                progress.event(Event::Warning(format!("tile `{}` failed: {}", tile.id, e.chain())));
                failed.push(tile.id.clone());
                first.get_or_insert(e);
            }
        }
    }
    match first {
        Some(first) if failed.len() == plan.tiles.len() => {
            Err(TilesError::AllFailed { first: Box::new(first) })
        }
        _ => Ok(failed),
    }
}

/// Scores the surface model against the truth, if there is one.
fn score(
    run: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), PipelineError> {
    let Some(truth) = &options.truth else { return Ok(()) };
    let scoring = EvaluateOptions { overwrite: true, ..options.evaluate.clone() };
    let evaluation = evaluate(&run.join(DSM), truth, &scoring, Some(&run.join(EVALUATION)), progress)?;
    completed(StageResult::Evaluated(Box::new(evaluation)));
    Ok(())
}
