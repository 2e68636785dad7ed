//! Scores of rendered images against satellite images that were held back from training.

use super::super::nvs_scores::{NvsScores, Protocol, ViewScore};
use super::super::run_folder::colors::SceneColors;
use super::super::run_folder::satellite_cameras::require_images;
use super::super::{PipelineError, TrainedCameras, read_scene, relocation};
use super::appearance;
use crate::affine::TrainingView;
use crate::nn::lpips::Lpips;
use crate::progress::{Event, Progress};
use crate::scene::Role;
use crate::splat::image_score::fitted_pair;
use crate::splat::loss::target::TargetImage;
use crate::splat::satellite::NovelView;
use std::path::Path;

/// Renders views of a trained run and compares them with their images: those of these names, else all test views.
pub fn nvs_eval(
    run: &Path,
    names: &[String],
    protocol: Option<Protocol>,
    lpips: Option<&Lpips<f32>>,
    progress: &dyn Progress,
) -> Result<NvsScores, PipelineError> {
    let scene = read_scene(run)?;
    require_images(&scene)?;
    relocation::finish(run)?;
    let cameras = TrainedCameras::read(run)?;
    let setup = &cameras.setup;
    let views = if names.is_empty() {
        setup.views.iter().filter(|v| v.role == Role::Test).collect()
    } else {
        names.iter().map(|name| cameras.find(name)).collect::<Result<Vec<_>, _>>()?
    };
    if views.is_empty() {
        return Err(PipelineError::NoTestView);
    }
    if let Some(colors) = SceneColors::read(run)? {
        let scoring = (protocol.unwrap_or(Protocol::Full), lpips);
        return appearance::nvs_eval(run, &colors, &scene, &views, scoring, progress);
    }
    if protocol.is_some_and(|p| p != Protocol::Half) {
        let what = "this protocol of scores";
        return Err(PipelineError::NoTrainedColors { run: run.into(), what });
    }
    let splats = cameras.read_splats(run)?;
    let reference = cameras.reference_appearance();
    let mut scores = Vec::new();
    progress.event(Event::Started { stage: "scoring views", total: views.len() as u64 });
    for view in views {
        progress.check()?;
        let name = || view.name.clone();
        let source = scene.views.iter().find(|v| v.name == view.name);
        let source = source.ok_or_else(|| PipelineError::ViewNotInScene { run: run.into(), name: name() })?;
        let planes = source.read_colors()?;
        let mut truth = TargetImage::default();
        let (area, altitudes) = (setup.area, setup.ray_altitudes());
        truth.load(&TrainingView::new(name(), view.camera, None, &planes, area, altitudes), 0);
        let novel = NovelView::from(view);
        let mut picture = novel.picture(&splats, &reference, setup.altitudes);
        // Scored as the images show it.
        setup.transfer_function.encode(&mut picture.colors);
        let pair = fitted_pair(&picture.colors, &truth);
        let score = pair.map(|pair| pair.score_with(lpips)).transpose()?.flatten();
        let score = score.ok_or_else(|| PipelineError::NothingToScore { name: name() })?;
        scores.push(ViewScore { view: name(), score, parts: None });
        progress.event(Event::Advanced { done: scores.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(NvsScores { protocol: Some(Protocol::Half), ..NvsScores::with_mean(scores) })
}
