//! Scores of renders against photographs that were held back from training.

use super::super::PipelineError;
use super::super::nvs_scores::{NvsScores, ViewScore};
use super::cameras::PerspectiveCameras;
use super::manifest::PerspectiveManifest;
use super::train::read_view;
use crate::io::write_json;
use crate::nn::lpips::Lpips;
use crate::progress::{Event, Progress};
use crate::run_files::{NVS_PICTURES, NVS_SCORES};
use crate::scene::Role;
use crate::splat::image_score::photograph_pair;
use crate::splat::pinhole::{PinholePicture, comparison};
use std::path::Path;

/// Largest number of comparisons that are written for the report.
const PICTURES: usize = 12;

/// Renders views of a trained run and compares them with their images: those of these names, else all test views. With
/// `written`, scores and comparisons are written into the run for the report.
pub fn nvs_eval(
    run: &Path,
    names: &[String],
    lpips: Option<&Lpips<f32>>,
    written: bool,
    progress: &dyn Progress,
) -> Result<NvsScores, PipelineError> {
    let scene = PerspectiveManifest::read(run)?.read_scene()?;
    let cameras = PerspectiveCameras::read(run)?;
    let views = if names.is_empty() {
        cameras.views.iter().filter(|v| v.role == Role::Test).collect()
    } else {
        names.iter().map(|name| cameras.find(name)).collect::<Result<Vec<_>, _>>()?
    };
    if views.is_empty() {
        return Err(PipelineError::NoTestView);
    }
    let splats = PerspectiveCameras::read_splats(run)?;
    let mut scores = Vec::new();
    let step = views.len().div_ceil(PICTURES).max(1);
    progress.event(Event::Started { stage: "scoring views", total: views.len() as u64 });
    for (i, view) in views.iter().enumerate() {
        progress.check()?;
        let name = || view.name.clone();
        let source = view.view_of(&scene, run)?;
        let truth = source.read_image()?.planes;
        let picture = PinholePicture::render(&splats, &view.camera());
        let score = photograph_pair(&picture.colors, &truth).score_with(lpips)?;
        let score = score.ok_or_else(|| PipelineError::NothingToScore { name: name() })?;
        if written && i % step == 0 {
            let shown = comparison(&read_view(source)?, &picture);
            shown.write(&run.join(format!("{NVS_PICTURES}/{i:04}.png")))?;
        }
        scores.push(ViewScore { view: name(), score });
        progress.event(Event::Advanced { done: scores.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    let scores = NvsScores::with_mean(scores);
    if written {
        write_json(&run.join(NVS_SCORES), &scores)?;
    }
    Ok(scores)
}
