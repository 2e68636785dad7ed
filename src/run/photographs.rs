//! All stages of a perspective scene.

use super::{ReadPhotographs, RunError, RunOptions, StageResult};
use crate::perspective::PerspectiveScene;
use crate::pipeline::{
    PerspectiveManifest, RunLock, dsm_locked, nvs_eval_locked, report, tell_of_scene, train_scene,
};
use crate::progress::{Event, Progress};
use crate::scene::Role;
use std::path::Path;

/// Trains a scene, scores the views that were held back, renders the surface model if the scene has a place on Earth, and writes
/// a report.
pub fn run(
    read: ReadPhotographs,
    options: &RunOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), RunError> {
    options.train.perspective_recipe()?;
    options.dsm.check(run)?;
    let ReadPhotographs { path, options: reading, scene } = read;
    let scene = scene.near_origin();
    let _lock = RunLock::make(run)?;
    PerspectiveManifest::require_no_satellites(run)?;
    if scene.georeference.is_none() {
        options.dsm.require_none()?;
    }
    tell_of_scene(&scene, progress);
    tell_of_unused(&path, &scene, options, progress);
    let manifest = PerspectiveManifest::new(&path, &reading, &scene);
    completed(StageResult::Trained(train_scene(run, &manifest, &scene, &options.train, progress)?));
    if scene.views.iter().any(|v| v.role == Role::Test) {
        completed(StageResult::Scored(nvs_eval_locked(run, progress)?));
    }
    if scene.georeference.is_some() {
        completed(StageResult::Dsm(dsm_locked(run, &options.dsm, progress)?));
    }
    completed(StageResult::Reported(report(run)?));
    Ok(())
}

/// Says which files and keys of a scene are not used, unless an option names them.
fn tell_of_unused(path: &Path, scene: &PerspectiveScene, options: &RunOptions, progress: &dyn Progress) {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    for (name, reason) in &scene.unused {
        if !options.train.priors.is_folder(&folder.join(name)) {
            progress.event(Event::Warning(format!("not used: {name}: {reason}")));
        }
    }
}
