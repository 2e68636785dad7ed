//! What a user is told about a perspective scene when it is read.

use super::super::PipelineError;
use crate::perspective::{PerspectiveError, PerspectiveScene, PoseCheck};
use crate::progress::{Event, Progress};
use std::path::Path;

/// The warning for a scene with one view to train on.
const ONE_VIEW: &str = "there is one view to train on: one photograph says nothing about depths, and other views of the result will \
     be wrong; add photographs of the same place, or give depths by --depth-prior";

/// Says what of a scene is left out, which colour camera it has, and where it lies on Earth.
pub fn tell_of_scene(scene: &PerspectiveScene, progress: &dyn Progress) {
    for (name, reason) in &scene.skipped {
        progress.event(Event::Warning(format!("`{name}` is left out: {reason}")));
    }
    if let Some((images, meaning)) = scene.transparency() {
        let text = format!("transparent pixels of {images} images are {}", meaning.meaning());
        progress.event(Event::Note(text));
    }
    if let Some(registration) = &scene.registration {
        progress.event(Event::Note(registration.to_string()));
    }
    if let Some(rejected) = &scene.rejected_registration {
        progress.event(Event::Warning(rejected.to_string()));
    }
    if let Some(moved) = scene.moved() {
        progress.event(Event::Note(moved));
    }
    if let Some(georeference) = &scene.georeference {
        progress.event(Event::Note(georeference.to_string()));
        georeference.warnings().for_each(|warning| progress.event(Event::Warning(warning.clone())));
    }
}

/// Checks before a training whether the cameras of the scene at a path are those of its photographs.
pub fn check_poses(
    path: &Path,
    scene: &PerspectiveScene,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    if scene.training().count() == 1 {
        progress.event(Event::Warning(ONE_VIEW.into()));
    }
    if let Some(warning) = PerspectiveScene::reprojection(path)?.and_then(|r| r.warning()) {
        progress.event(Event::Warning(warning));
    }
    progress.event(Event::Started { stage: "comparing photographs with their poses", total: 0 });
    let check = PoseCheck::of(&scene.views, &scene.points);
    progress.event(Event::Finished);
    if let Some(finding) = check.refusal() {
        let (finding, next_step) = (finding.clone(), finding.next_step());
        return Err(PerspectiveError::Contradicted { path: path.into(), finding, next_step }.into());
    }
    progress.event(Event::Note(check.to_string()));
    check.warnings().for_each(|warning| progress.event(Event::Warning(warning)));
    Ok(())
}
