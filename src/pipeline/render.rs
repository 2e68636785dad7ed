//! Images of a trained run from any direction, under any sun: `satgs render`.

use super::render_options::{RenderOptions, RenderSummary};
use super::run_folder::perspective_manifest;
use super::{PipelineError, perspective, satellite};
use crate::progress::Progress;
use std::path::Path;

/// Renders images of a trained run. A `.png` holds colours; a `.tif` also the height of what is seen, of trained
/// colours the share of sunlight, and its place.
///
/// # Errors
/// [`PipelineError`]: the run is not trained or has no such view, a direction is too near to the horizon, a file cannot
/// be written, the caller asked to stop.
pub fn render(
    run: &Path,
    output: &Path,
    options: &RenderOptions,
    progress: &dyn Progress,
) -> Result<RenderSummary, PipelineError> {
    let is_raster = match output.extension().map(|e| e.to_string_lossy().to_lowercase()).as_deref() {
        Some("png") => false,
        Some("tif") => true,
        _ => return Err(PipelineError::ImageFormat { path: output.into() }),
    };
    if ((options.depth || options.normals) && !is_raster) || (options.strip && is_raster) {
        return Err(PipelineError::ImageFormat { path: output.into() });
    }
    if perspective_manifest::is_run(run) {
        perspective::render(run, output, is_raster, options, progress)
    } else {
        satellite::render(run, output, is_raster, options, progress)
    }
}
