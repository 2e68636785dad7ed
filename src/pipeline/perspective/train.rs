//! Training of a perspective scene.

use super::super::PipelineError;
use super::super::checkpoints::Checkpoints;
use super::super::predict::{prediction_of, read_predicted};
use super::super::stage::{Fingerprint, Outcome, Stage, hash, hash_file};
use super::super::train_options::TrainOptions;
use super::super::trained::{Trained, mean_of_last};
use super::super::training_files::write_log;
use super::cameras::{PerspectiveCameras, TrainedPhoto};
use super::images::require_own_images;
use super::manifest::PerspectiveManifest;
use super::prior_pictures;
use super::priors::{matched_scene, prior_sources, priors, starts_from_matches};
use super::reading::check_poses;
use super::scene_fingerprint::scene_fingerprint;
use super::start::splats_at_start;
use crate::affine::SiteSceneError;
use crate::io::write_json;
use crate::perspective::{PerspectiveScene, PerspectiveView, PinholeCamera};
use crate::predict::Model;
use crate::prior::{PriorContent, PriorFolder, PriorMaker, PriorSource};
use crate::progress::{Event, Progress};
use crate::run_files::{CAMERAS, CHECKPOINT, PRIOR_PICTURES, SNAPSHOTS, SPLATS, START, TRAINING};
use crate::scene::Role;
use crate::splat::appearance::AppearanceKind;
use crate::splat::backend::TrainingBackend;
use crate::splat::pinhole::{PinholeBackend, PinholeScene, PinholeView, WorkingFrame, comparison, extent_m};
use crate::splat::ply;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::recipe::Recipe;
use crate::splat::train::{Schedule, pictures, train as optimize};
use crate::stats::quantile;
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// The box of the splats leaves out this share at each side: a few float far away.
const OUTSIDE: f64 = 0.02;

/// Trains the perspective scene of a run, unless that was done with the same input and options; goes on from a checkpoint of
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
pub(super) fn train_scene(
    run: &Path,
    manifest: &PerspectiveManifest,
    scene: &PerspectiveScene,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Trained>, PipelineError> {
    let recipe = options.perspective_recipe_for(scene.training().count())?;
    let frame = WorkingFrame::of(scene)?;
    let outputs = [SPLATS, CAMERAS].map(|name| run.join(name)).into();
    let stage = Stage::new(run, "train", outputs, fingerprint(run, scene, &frame, options, &recipe)?);
    let is_done = stage.is_done(options.overwrite)?;
    let (every, is_required) = (options.checkpoint_every, options.resume);
    let checkpoints = Checkpoints { path: run.join(CHECKPOINT), stage: &stage, every, is_required };
    let taken_up = if is_done { None } else { checkpoints.take_up(0, options.overwrite, progress)? };
    manifest.write(run)?;
    if is_done {
        progress.event(Event::Note(format!("`{}` is trained already", run.display())));
        return Ok(Outcome::Kept(stage.summary()?));
    }
    stage.require_writable()?;
    if taken_up.is_none() {
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
    let (at_start, mut log, state) = match taken_up {
        Some(c) => (c.splats_at_start, c.log.into_owned(), c.state.into_owned()),
        None => {
            let _ = std::fs::remove_dir_all(run.join(SNAPSHOTS));
            let _ = std::fs::remove_dir_all(run.join(START));
            let _ = std::fs::remove_dir_all(run.join(PRIOR_PICTURES));
            let site = scene.georeference.as_ref().map(|g| &g.grid);
            let predicted = read_predicted(run, &scene_fingerprint(scene)?, site)?;
            let predicted = predicted.map(|(splats, _)| frame.enter_splats(splats));
            let start = splats_at_start(&working, predicted, &views, &recipe, options, run, progress)?;
            let (count, appearance) = (start.splats.len(), AppearanceKind::default());
            let state = TrainingState::start(start, appearance, 0, options.seed);
            (count, Vec::new(), state)
        }
    };
    let schedule = Schedule {
        recipe: &recipe,
        views: views.len(),
        half_side_m: extent_m(&cameras),
        pixel_m: 0.0,
        splats_at_start: at_start,
        is_gray: false,
        seed: options.seed,
    };
    let views = Arc::new(views);
    let mut backend = PinholeBackend::default();
    backend.load(PinholeScene { views: views.clone() }, state)?;
    progress.event(Event::Resumable(true));
    let is_picture_due = |done: u32| pictures::is_snapshot_due(options.snapshots, done, recipe.iterations);
    let is_due = |done: u32| is_picture_due(done) || checkpoints.is_due(done);
    optimize(&mut backend, &schedule, &mut log, progress, is_due, |backend, log| {
        let done = log.len() as u32;
        if is_picture_due(done) {
            let shown = comparison(&views[0], &backend.render(&views[0].camera, 0)?);
            // A picture less is no reason to stop.
            if let Err(e) = shown.write(&run.join(format!("{SNAPSHOTS}/{done:06}.png"))) {
                progress.event(Event::Warning(e.to_string()));
            }
        }
        checkpoints.keep(at_start, log, backend, progress)
    })?;
    progress.event(Event::Resumable(false));

    tracing::info!("{}", backend.times().table());
    let splats = &backend.snapshot()?.splats;
    write_log(&run.join(TRAINING), &log)?;
    pictures::curves(&log).write(&run.join("train/curves.svg"))?;
    if let Err(e) = prior_pictures::write_pictures(&run.join(PRIOR_PICTURES), &views, splats) {
        progress.event(Event::Warning(e.to_string()));
    }
    let splats = frame.leave_splats(splats.clone());
    let cameras = write_trained(run, scene, &frame, &splats, recipe)?;
    let trained = Trained {
        iterations: cameras.recipe.iterations,
        seconds: log.last().map_or(0.0, |l| l.seconds),
        splats_start: at_start,
        splats: splats.len(),
        camera_rms_px: None,
        camera_max_px: None,
        l1: Some(mean_of_last(&log, views.len(), "l1")),
        ssim: Some(mean_of_last(&log, views.len(), "ssim")),
        colors: None,
    };
    stage.complete(&trained)?;
    checkpoints.remove();
    Ok(Outcome::Made(trained))
}

/// Writes the splats of a scene, in its own frame, and its cameras to a run folder.
pub fn write_trained(
    run: &Path,
    scene: &PerspectiveScene,
    frame: &WorkingFrame,
    splats: &Splats,
    recipe: Recipe,
) -> Result<PerspectiveCameras, PipelineError> {
    let site = scene.georeference.as_ref().map(|g| g.grid);
    match &site {
        Some(site) => ply::write(&run.join(SPLATS), splats, site)?,
        None => ply::write_local(&run.join(SPLATS), splats)?,
    }
    let [x, y, z] = [0, 1, 2].map(|k| range(splats, k));
    let training: Vec<PinholeCamera> = scene.training().map(|v| v.camera).collect();
    let cameras = PerspectiveCameras {
        site,
        extent_m: extent_m(&training),
        unit: frame.unit(),
        area: (x.0, y.0, x.1, y.1),
        altitudes: z,
        views: scene.views.iter().map(TrainedPhoto::new).collect(),
        recipe,
    };
    write_json(&run.join(CAMERAS), &cameras)?;
    Ok(cameras)
}

/// Reads the images of the training views.
pub fn read_views(
    scene: &PerspectiveScene,
    progress: &dyn Progress,
) -> Result<Vec<PinholeView>, PipelineError> {
    let training: Vec<&PerspectiveView> = scene.training().collect();
    if training.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let held_back: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.role == Role::Test).collect();
    let total = (training.len() + held_back.len()) as u64;
    progress.event(Event::Started { stage: "reading images", total });
    let mut views = Vec::with_capacity(training.len());
    // As many at a time as there are threads: an undistorted image is several times as large as what is kept of it.
    let at_a_time = rayon::current_num_threads().max(1);
    // What is wrong with a view to be scored shows before the training.
    for (k, some) in held_back.chunks(at_a_time).enumerate() {
        progress.check()?;
        some.par_iter()
            .map(|view| view.read_image().map(drop))
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<(), _>>()?;
        let done = held_back.len().min((k + 1) * at_a_time) as u64;
        progress.event(Event::Advanced { done, status: String::new() });
    }
    for some in training.chunks(at_a_time) {
        progress.check()?;
        let read: Vec<Result<PinholeView, PipelineError>> =
            some.par_iter().map(|view| read_view(view)).collect();
        for view in read {
            views.push(view?);
        }
        let done = (held_back.len() + views.len()) as u64;
        progress.event(Event::Advanced { done, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(views)
}

/// A view with its pixels.
pub(super) fn read_view(view: &PerspectiveView) -> Result<PinholeView, PipelineError> {
    Ok(PinholeView::of_image(view.name.clone(), view.camera, &view.read_image()?))
}

/// Lowest and highest coordinate of the splats, without the outermost.
fn range(splats: &Splats, axis: usize) -> (f64, f64) {
    let values = || splats.position.iter().map(|p| f64::from(p[axis])).collect();
    let at = |share: f64| quantile(values(), share).unwrap_or(0.0);
    (at(OUTSIDE), at(1.0 - OUTSIDE))
}

/// What a training is made from; its keys are the names of options on the command line.
fn fingerprint(
    run: &Path,
    scene: &PerspectiveScene,
    frame: &WorkingFrame,
    options: &TrainOptions,
    recipe: &Recipe,
) -> Result<Fingerprint, PipelineError> {
    let json = |what: &'static str, value: Result<String, serde_json::Error>| {
        value.map_err(|source| PipelineError::Json { what, source })
    };
    let choices = json("the recipe", serde_json::to_string(&options.recipe_as_written()?))?;
    let mut out = scene_fingerprint(scene)?;
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
