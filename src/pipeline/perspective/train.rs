//! Training of a perspective scene.

use super::super::PipelineError;
use super::super::photographs::{check_poses, read_views, require_own_images};
use super::super::predict::{prediction_of, read_predicted};
use super::super::run_folder::perspective_cameras::{PerspectiveCameras, write_trained};
use super::super::run_folder::perspective_fingerprint::perspective_fingerprint;
use super::super::run_folder::perspective_manifest::PerspectiveManifest;
use super::super::run_folder::stage::{Fingerprint, Outcome, hash, hash_file};
use super::super::train_options::TrainOptions;
use super::super::trained::Trained;
use super::super::training_stage::{TrainingSoFar, TrainingStage};
use super::device::train_photographs;
use super::prior_pictures;
use super::priors::{matched_scene, prior_sources, priors, starts_from_matches};
use super::start::splats_at_start;
use crate::perspective::PerspectiveScene;
use crate::predict::Model;
use crate::prior::{PriorContent, PriorFolder, PriorMaker, PriorSource};
use crate::progress::{Event, Progress};
use crate::run_files::{CAMERAS, PRIOR_PICTURES, SPLATS, START, TRAIN_STAGE};
use crate::splat::appearance::AppearanceKind;
use crate::splat::pinhole::{PinholeView, WorkingFrame, extent_m};
use crate::splat::recipe::{PerspectiveRecipe, Recipe};
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;
use std::path::Path;
use std::sync::Arc;

/// Trains the perspective scene of a run, unless that was done with the same input and options; continues from a checkpoint of
/// the same input and options. The caller holds the lock.
///
/// Writes `RUN/splats.ply`, `RUN/cameras.json` and `RUN/train`.
pub fn train_locked(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Trained>, PipelineError> {
    let manifest = PerspectiveManifest::read(run)?;
    let scene = manifest.read_scene()?;
    train_scene(run, &manifest, &scene, options, progress)
}

/// As [`train_locked`], of a scene that was read already. Its manifest is written unless the run was made from another scene.
pub fn train_scene(
    run: &Path,
    manifest: &PerspectiveManifest,
    scene: &PerspectiveScene,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Trained>, PipelineError> {
    let recipe = options.perspective_recipe_for(scene.training().count())?;
    let frame = WorkingFrame::of(scene)?;
    let fingerprint = fingerprint(run, scene, &frame, options, &recipe)?;
    let stage = TrainingStage::new(run, TRAIN_STAGE, &[SPLATS, CAMERAS], fingerprint, (options, progress));
    let is_done = stage.is_done()?;
    let interrupted = if is_done { None } else { stage.resume(0)? };
    manifest.write(run)?;
    if is_done {
        progress.event(Event::Note(format!("`{}` is trained already", run.display())));
        return Ok(Outcome::Kept(stage.summary()?));
    }
    stage.require_writable()?;
    if interrupted.is_none() {
        check_poses(&manifest.scene, scene, progress)?;
    }
    let matched = matched_scene(run, scene, options, progress)?;
    let scene = matched.as_ref().unwrap_or(scene);
    let working = frame.enter(scene);
    // Before the images, which need memory that networks may need too.
    let priors = priors(run, scene, &frame, options, progress)?;
    let views = read_views(&working, progress)?;
    require_own_images(&manifest.scene, &working, &views, progress)?;
    let views = views.into_iter().zip(priors);
    let views: Vec<PinholeView> = views.map(|(view, priors)| view.with_priors(priors)).collect();
    let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
    let so_far = match interrupted {
        Some(interrupted) => interrupted,
        None => {
            stage.remove_snapshots();
            let _ = std::fs::remove_dir_all(run.join(START));
            let _ = std::fs::remove_dir_all(run.join(PRIOR_PICTURES));
            let site = scene.georeference.as_ref().map(|g| &g.grid);
            let predicted = read_predicted(run, &perspective_fingerprint(scene)?, site)?;
            let predicted = predicted.map(|(splats, _)| frame.enter_splats(splats));
            let start = splats_at_start(&working, predicted, &views, &recipe, options, run, progress)?;
            TrainingSoFar::start(TrainingState::start(start, AppearanceKind::default(), 0, options.seed))
        }
    };
    let schedule = Schedule {
        recipe: &recipe.clone().of_any(),
        views: views.len(),
        half_side_m: extent_m(&cameras),
        pixel_m: 0.0,
        splats_at_start: so_far.splats_at_start,
        is_gray: false,
        seed: options.seed,
    };
    {
        let splats = frame.leave_splats(so_far.state.splats.clone());
        stage.write_cameras(&PerspectiveCameras::new(scene, &frame, &splats, recipe.clone()))?;
    }
    let views = Arc::new(views);
    let (so_far, device) = train_photographs(&stage, &views, &schedule, so_far, (options.device, progress))?;

    let splats = &so_far.state.splats;
    if let Err(e) = prior_pictures::write_pictures(&run.join(PRIOR_PICTURES), &views, splats) {
        progress.event(Event::Warning(e.to_string()));
    }
    let splats = frame.leave_splats(splats.clone());
    let cameras = write_trained(run, scene, &frame, &splats, recipe)?;
    let trained = Trained {
        iterations: cameras.recipe.iterations,
        seconds: so_far.seconds(),
        splats_start: so_far.splats_at_start,
        splats: splats.len(),
        camera_rms_px: None,
        camera_max_px: None,
        l1: Some(so_far.mean_of_last(views.len(), "l1")),
        ssim: Some(so_far.mean_of_last(views.len(), "ssim")),
        device,
        colors: None,
    };
    stage.complete(&trained)?;
    Ok(Outcome::Made(trained))
}

/// What a training is made from; its keys are the names of options on the command line.
fn fingerprint(
    run: &Path,
    scene: &PerspectiveScene,
    frame: &WorkingFrame,
    options: &TrainOptions,
    recipe: &Recipe<PerspectiveRecipe>,
) -> Result<Fingerprint, PipelineError> {
    let json = |what: &'static str, value: Result<String, serde_json::Error>| {
        value.map_err(|source| PipelineError::Json { what, source })
    };
    let choices = json("the recipe", serde_json::to_string(&options.recipe_as_written()?))?;
    let mut out = perspective_fingerprint(scene)?;
    let prediction = prediction_of(run, &out)?;
    out.extend([
        ("--recipe".into(), recipe.name.clone()),
        ("content of the recipe".into(), hash(choices.as_bytes())),
        ("--iterations".into(), recipe.iterations.to_string()),
        ("--seed".into(), options.seed.to_string()),
        ("frame of training".into(), format!("{frame:?}")),
    ]);
    if let Some(prediction) = prediction {
        out.insert("predicted splats".into(), prediction);
    } else if options.predict {
        out.insert("--start".into(), format!("predict, {}", Model::built_in_hash()));
    }
    let stereo = PriorMaker::Stereo;
    if starts_from_matches(run, scene, options)? {
        out.insert("points to start from".into(), hash(stereo.hash(PriorContent::Depths)?.as_bytes()));
    }
    let all = prior_sources(scene, options)?;
    let sources = [
        ("--depth-prior", &all.depths, PriorContent::Depths),
        ("--normal-prior", &all.normals, PriorContent::Normals),
    ];
    for (option, source, content) in sources {
        let described = match source {
            None => continue,
            Some(PriorSource::Folder(path)) => {
                let folder = PriorFolder::open(path)?;
                let file = |view| folder.file(view).map_or(String::new(), |file| hash_file(&file));
                let files: Vec<String> = scene.training().map(file).collect();
                format!("{:?} {:?} {}", options.priors.kind, folder.description(), files.join(" "))
            }
            // The images are part of the fingerprint already.
            Some(PriorSource::Maker(maker)) => format!("{:?} {}", options.priors.kind, maker.hash(content)?),
        };
        out.insert(option.into(), hash(described.as_bytes()));
    }
    if options.reference_points && scene.layout.has_reference_depths() {
        out.insert("--reference-points".into(), "given".into());
    }
    if let Some(command) = &options.inpaint {
        out.insert("--inpaint".into(), command.text().into());
    }
    Ok(out)
}
