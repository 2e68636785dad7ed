//! All stages of the run of a perspective scene.

use super::dsm::dsm_locked;
use super::perspective::{nvs_eval, train_scene};
use super::run_folder::perspective_manifest::{PerspectiveManifest, is_run};
use super::run_folder::tell_of_scene::tell_of_scene;
use super::stage_result::StageResult;
use super::{DsmOptions, PipelineError, RunLock, TrainOptions, report};
use crate::perspective::{PerspectiveOptions, PerspectiveScene};
use crate::progress::{Event, Progress};
use crate::run_files::SCENE;
use crate::scene::Role;
use crate::splat::recipe::Recipe;
use std::path::{Path, PathBuf};

/// Options of all stages.
#[derive(Clone, Debug)]
pub struct PerspectiveRunOptions {
    /// How the scene is read.
    pub scene: PerspectiveOptions,
    /// Of the training.
    pub train: TrainOptions,
    /// Of the surface model, which scenes with a place on Earth have.
    pub dsm: DsmOptions,
}

impl Default for PerspectiveRunOptions {
    fn default() -> Self {
        let recipe = Recipe::OF_PERSPECTIVE_SCENES.into();
        Self {
            scene: PerspectiveOptions::default(),
            train: TrainOptions { recipe, ..TrainOptions::default() },
            dsm: DsmOptions::default(),
        }
    }
}

/// An entry of the folder of a scene.
fn name_in(scene: &Path, name: &str) -> PathBuf {
    let folder = if scene.is_dir() { scene } else { scene.parent().unwrap_or(Path::new("")) };
    folder.join(name)
}

/// Trains a perspective scene, scores the views that were held back, renders the surface model if the scene has a place on
/// Earth, and writes a report. `completed` receives the result of every stage as soon as it is there. Stages that are complete
/// already are kept.
///
/// # Errors
/// [`PipelineError`] of the first stage that fails.
pub fn run_perspective(
    scene: &Path,
    options: &PerspectiveRunOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), PipelineError> {
    options.train.perspective_recipe()?;
    options.dsm.check(run)?;
    let read = PerspectiveScene::read(scene, &options.scene)?.near_origin();
    let _lock = RunLock::make(run)?;
    if run.join(SCENE).exists() && !is_run(run) {
        return Err(PipelineError::OfSatellites { run: run.into() });
    }
    if read.georeference.is_none() {
        options.dsm.require_none()?;
    }
    tell_of_scene(&read, progress);
    for (name, reason) in &read.unused {
        if !options.train.priors.is_folder(&name_in(scene, name)) {
            progress.event(Event::Warning(format!("not used: {name}: {reason}")));
        }
    }
    let manifest = PerspectiveManifest::new(scene, &options.scene, &read);
    completed(StageResult::Trained(train_scene(run, &manifest, &read, &options.train, progress)?));
    if read.views.iter().any(|v| v.role == Role::Test) {
        completed(StageResult::Scored(nvs_eval(run, &[], None, true, progress)?));
    }
    if read.georeference.is_some() {
        completed(StageResult::Dsm(dsm_locked(run, &options.dsm, progress)?));
    }
    completed(StageResult::Reported(report(run)?));
    Ok(())
}
