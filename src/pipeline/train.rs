//! Training of a run: `satgs train`.

use super::report::renew_report;
use super::run_folder::perspective_manifest;
use super::run_folder::stage::Outcome;
use super::run_folder::tiled::{require_no_tile, require_one_area};
use super::surface_source::SurfaceIsKnown;
use super::train_options::TrainOptions;
use super::trained::Trained;
use super::{PipelineError, RunLock, outdated, perspective, satellite};
use crate::progress::Progress;
use std::path::Path;

/// Trains an adjusted run, or that of a perspective scene, unless that was done with the same input and options; continues from
/// a checkpoint of the same input and options.
///
/// Writes `RUN/splats.ply`, `RUN/cameras.json` and `RUN/train`.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted, is in use or was trained from something else, the images are gone, the
/// recipe or an option is wrong, a file cannot be written. When `progress` asks to stop, a checkpoint is written and the
/// error is [`PipelineError::TrainingInterrupted`].
pub fn train(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Trained>, PipelineError> {
    let _lock = RunLock::existing(run)?;
    require_one_area(run)?;
    require_no_tile(run)?;
    let outcome = train_locked(run, options, progress, &mut |_| Ok(()))?;
    if matches!(outcome, Outcome::Made(_)) {
        outdated::say_outdated(run, progress)?;
        renew_report(run)?;
    }
    Ok(outcome)
}

/// As [`train`]; the caller holds the lock.
pub(crate) fn train_locked(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    let trained = if perspective_manifest::is_run(run) {
        perspective::train_locked(run, options, progress)?
    } else {
        satellite::train_locked(run, options, progress, surface_is_known)?
    };
    if matches!(trained, Outcome::Made(_)) {
        outdated::after_training(run, progress)?;
    }
    Ok(trained)
}
