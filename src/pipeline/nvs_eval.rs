//! Scores of rendered images against images that were held back from training: `satgs nvs-eval`.

use super::nvs_scores::{NvsOptions, NvsScores};
use super::run_folder::perspective_manifest;
use super::{PipelineError, perspective, satellite};
use crate::nn::lpips::Lpips;
use crate::progress::Progress;
use std::path::Path;

/// Renders views of a trained run and compares them with their images.
///
/// # Errors
/// [`PipelineError`]: the run is not trained or has no such view, no test view or no colours for the protocol, an image is
/// gone, the caller asked to stop.
pub fn nvs_eval(
    run: &Path,
    options: &NvsOptions,
    progress: &dyn Progress,
) -> Result<NvsScores, PipelineError> {
    let NvsOptions { views, protocol, lpips } = options;
    let lpips = lpips.as_deref().map(Lpips::read).transpose()?;
    if !perspective_manifest::is_run(run) {
        return satellite::nvs_eval(run, views, *protocol, lpips.as_ref(), progress);
    }
    if protocol.is_some() {
        let what = "this protocol of scores";
        return Err(PipelineError::NoTrainedColors { run: run.into(), what });
    }
    perspective::nvs_eval(run, views, lpips.as_ref(), false, progress)
}

/// Scores the test views of the run of a perspective scene, and writes scores and comparisons for the report; the caller holds the
/// lock.
pub(crate) fn nvs_eval_locked(run: &Path, progress: &dyn Progress) -> Result<NvsScores, PipelineError> {
    perspective::nvs_eval(run, &[], None, true, progress)
}
