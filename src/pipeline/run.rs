//! All stages of a run in a row: `satgs run`.

use super::adjust::adjust_locked;
use super::dsm::{before_training, dsm_locked};
use super::surface_source::KnownSurface;
use super::train::train_locked;
use super::{
    AdjustOptions, DsmOptions, EvaluateOptions, PipelineError, RunLock, StageResult, TrainOptions, evaluate,
    report,
};
use crate::metrics::Truth;
use crate::progress::Progress;
use crate::run_files::{DSM, EVALUATION};
use crate::scene::Scene;
use std::path::{Path, PathBuf};

/// Options of all stages.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Of the adjustment.
    pub adjust: AdjustOptions,
    /// Of the training.
    pub train: TrainOptions,
    /// Of the surface model.
    pub dsm: DsmOptions,
    /// A surface model or points to score the result against.
    pub truth: Option<PathBuf>,
    /// How the truth is read.
    pub evaluate: EvaluateOptions,
}

impl RunOptions {
    /// Opens the files that late stages read, so that errors are found before a long training.
    ///
    /// # Errors
    /// [`PipelineError`] of the option that is wrong.
    pub fn check(&self, run: &Path) -> Result<(), PipelineError> {
        self.train.satellite_recipe()?;
        self.dsm.check(run)?;
        match &self.truth {
            Some(truth) => Ok(Truth::check(truth, &self.evaluate.truth_options()?)?),
            None => Ok(()),
        }
    }
}

/// Adjusts, trains, renders, scores if there is a truth, and writes a report. `completed` receives the result of every
/// stage as soon as it is there. Stages that are complete already are kept.
///
/// # Errors
/// [`PipelineError`] of the first stage that fails. Files that late stages read are opened first.
pub fn run(
    scene: &Scene,
    options: &RunOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), PipelineError> {
    options.check(run)?;
    let _lock = RunLock::make(run)?;
    completed(StageResult::Adjusted(adjust_locked(scene, &options.adjust, run, progress)?));
    run_adjusted(run, options, progress, completed)
}

/// The stages of [`run`] after the adjustment; the caller holds the lock.
pub(crate) fn run_adjusted(
    run: &Path,
    options: &RunOptions,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), PipelineError> {
    let mut surface_is_known = |known: KnownSurface| before_training(run, &options.dsm, &known, progress);
    let trained = train_locked(run, &options.train, progress, &mut surface_is_known)?;
    completed(StageResult::Trained(trained));
    completed(StageResult::Dsm(dsm_locked(run, &options.dsm, progress)?));
    if let Some(truth) = &options.truth {
        let scoring = EvaluateOptions { overwrite: true, ..options.evaluate.clone() };
        let evaluation = evaluate(&run.join(DSM), truth, &scoring, Some(&run.join(EVALUATION)), progress)?;
        completed(StageResult::Evaluated(Box::new(evaluation)));
    }
    completed(StageResult::Reported(report(run)?));
    Ok(())
}
