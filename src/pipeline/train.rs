//! Training of an adjusted run: `satgs train`.

use super::appearance::OtherNetworks;
use super::cameras::require_images;
use super::checkpoints::Checkpoints;
use super::predict::prediction_of;
use super::report::renew_report;
use super::stage::{Fingerprint, Outcome, Stage, adjustment_fingerprint, hash};
use super::tiled::{require_no_tile, require_one_area};
use super::train_options::TrainOptions;
use super::trained::{Trained, mean, mean_of_last};
use super::training::Training;
use super::{
    PipelineError, RunLock, TrainedCameras, appearance, outdated, perspective, read_scene, relocation,
};
use crate::affine::{SiteSceneError, median_pixel_m};
use crate::mvs::MatchedSurface;
use crate::predict::Model;
use crate::progress::{Event, Progress};
use crate::run_files::{CAMERAS, CHECKPOINT, SPLATS};
use crate::scene::Scene;
use crate::splat::appearance::satgs::Cube;
use crate::splat::backend::cpu::CpuBackend;
use crate::splat::backend::{TrainingBackend, TrainingScene};
use crate::splat::loss::{Prior, TermInputs};
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::expectation::Extent;
use crate::splat::train::recipe::Recipe;
use crate::splat::train::{LogLine, Schedule, train as optimize};
use std::path::Path;
use std::sync::Arc;

/// Trains an adjusted run, or that of a perspective scene, unless that was done with the same input and options; goes on from a checkpoint of the same
/// input and options.
///
/// Writes `RUN/splats.ply`, `RUN/cameras.json` and `RUN/train`.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted, is in use or was trained from something else, the images are gone, the
/// recipe or an option is wrong, a file cannot be written. When `progress` asks to stop, a checkpoint is written and the
/// error is [`PipelineError::TrainingInterrupted`].
pub fn train(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Trained>, PipelineError> {
    let _lock = RunLock::existing(run)?;
    require_one_area(run)?;
    require_no_tile(run)?;
    let outcome = train_locked(run, options, progress, &mut |_| Ok(()))?;
    if matches!(outcome, Outcome::Made(_)) {
        outdated::say_outdated(run, progress)?;
        renew_report(run)?;
    }
    Ok(outcome)
}

/// A surface whose heights training will not change, with the cameras and splats that training starts from.
pub(crate) struct KnownSurface<'a> {
    pub cameras: TrainedCameras,
    pub splats: &'a Splats,
    pub heights: &'a MatchedSurface,
}

/// What is done with a known surface before splats are trained.
pub(crate) type SurfaceIsKnown<'a> = &'a mut dyn FnMut(KnownSurface) -> Result<(), PipelineError>;

/// As [`train`]; the caller holds the lock.
pub(crate) fn train_locked(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    let trained = if perspective::is_run(run) {
        perspective::train_locked(run, options, progress)?
    } else {
        train_satellites(run, options, progress, surface_is_known)?
    };
    if matches!(trained, Outcome::Made(_)) {
        outdated::after_training(run, progress)?;
    }
    Ok(trained)
}

/// The training of a satellite scene.
fn train_satellites(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    relocation::finish_locked(run)?;
    let scene = read_scene(run)?;
    let recipe = options.recipe_for(scene.training().count())?;
    let then = recipe.then.clone();
    // Files are read before the long training.
    let networks = then.as_ref().map(|_| OtherNetworks::read(options)).transpose()?;
    let trained = train_heights(run, options, recipe, &scene, progress, surface_is_known)?;
    let Some((then, networks)) = then.zip(networks) else { return Ok(trained) };
    let colors = appearance::train_locked(run, options, &then, networks, &scene, progress)?;
    Ok(trained.with_colors(colors))
}

/// The training for heights.
fn train_heights(
    run: &Path,
    options: &TrainOptions,
    recipe: Recipe,
    scene: &Scene,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    let outputs = [SPLATS, CAMERAS].map(|name| run.join(name)).into();
    let stage = Stage::new(run, "train", outputs, fingerprint(run, options, &recipe)?);
    if stage.is_done(options.overwrite)? {
        progress.event(Event::Note(format!("`{}` is trained already", run.display())));
        return Ok(Outcome::Kept(stage.summary()?));
    }
    stage.require_writable()?;
    require_images(scene)?;
    let mut training = Training::new(run, options, recipe, scene)?;
    let (extent, threads) = (Extent::of(&training.setup), rayon::current_num_threads());
    let is_usual = training.recipe.name == Recipe::NAMES[0] && options.iterations.is_none();
    if is_usual && !options.no_splats && extent.views > 1 {
        let expected = extent.expectation(&training.recipe, threads);
        progress.event(Event::Note(expected.text(&extent, threads)));
    }
    let views = training.setup.training_views(scene)?;
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let (every, is_required) = (options.checkpoint_every, options.resume);
    let checkpoints = Checkpoints { path: run.join(CHECKPOINT), stage: &stage, every, is_required };
    let taken_up = checkpoints.take_up(views.len(), options.overwrite, progress)?;
    let is_new = taken_up.is_none();
    if is_new {
        training.match_surface(&views, progress)?;
    }
    // Read from the file whether or not training was interrupted, so that both give the same bytes.
    let first = training.first_surface()?;
    training.bound_altitudes(first.as_ref());
    let (at_start, mut log, state) = match taken_up {
        Some(c) => (c.splats_at_start, c.log.into_owned(), c.state.into_owned()),
        None => {
            let (start, appearances) = training.splats_at_start(&views, first.as_ref(), progress)?;
            let splats_at_start = start.splats.len();
            let kind = training.recipe.appearance;
            let mut state = TrainingState::start(start, kind, views.len(), options.seed);
            let found = appearances.into_iter().filter(|a| a.kind == kind);
            state.appearances.iter_mut().zip(found).for_each(|((appearance, _), found)| *appearance = found);
            (splats_at_start, Vec::new(), state)
        }
    };
    let prior = first.as_ref().map(|first| Arc::new(Prior::new(first)));
    let inputs = TermInputs { prior, lpips: None };
    let schedule = Schedule {
        recipe: &training.recipe,
        views: views.len(),
        half_side_m: training.setup.half_side_m(),
        pixel_m: median_pixel_m(&views),
        splats_at_start: at_start,
        is_gray: views.iter().all(|view| view.is_gray),
        seed: options.seed,
    };
    let views = Arc::new(views);
    let (altitudes, appearance) = (training.setup.altitudes, training.recipe.appearance);
    let cube = Cube::around(training.setup.area, altitudes);
    let mut backend = CpuBackend::default();
    backend.load(
        TrainingScene { views: views.clone(), altitudes, inputs, appearance, cube, visibility: None },
        state,
    )?;
    if !options.no_splats {
        if let Some(heights) = first.as_ref().filter(|_| is_new && !training.refines_surface()) {
            let start = backend.snapshot()?;
            let cameras = training.cameras(start, &views, first.as_ref());
            surface_is_known(KnownSurface { cameras, splats: &start.splats, heights })?;
        }
        progress.event(Event::Resumable(true));
        let is_due = |done: u32| training.is_picture_due(done) || checkpoints.is_due(done);
        optimize(&mut backend, &schedule, &mut log, progress, is_due, |backend, log| {
            training.take_picture(backend, &views, log.len() as u32, progress)?;
            checkpoints.keep(at_start, log, backend, progress)
        })?;
        progress.event(Event::Resumable(false));
        tracing::info!("{}", backend.times().table());
    }
    let cameras = training.write(&mut backend, &views, first.as_ref(), &log)?;
    let trained = figures(&cameras, &log, at_start, backend.snapshot()?.splats.len());
    stage.complete(&trained)?;
    checkpoints.remove();
    Ok(Outcome::Made(trained))
}

fn figures(cameras: &TrainedCameras, log: &[LogLine], splats_start: usize, splats: usize) -> Trained {
    let fits = &cameras.setup.views;
    let views = cameras.appearances.len();
    let of_images = |column| (!log.is_empty()).then(|| mean_of_last(log, views, column));
    Trained {
        iterations: log.len() as u32,
        seconds: log.last().map_or(0.0, |l| l.seconds),
        splats_start,
        splats,
        camera_rms_px: Some(mean(fits.iter().map(|v| v.rms_px))),
        camera_max_px: Some(fits.iter().map(|v| v.max_px).fold(0.0, f64::max)),
        l1: of_images("l1"),
        ssim: of_images("ssim"),
        colors: None,
    }
}

/// What a training is made from; its keys are the names of options on the command line.
fn fingerprint(run: &Path, options: &TrainOptions, recipe: &Recipe) -> Result<Fingerprint, PipelineError> {
    // As written, so that another --iterations is not reported as a change of the whole recipe.
    // The training of colours that may follow is a stage of its own.
    let own = Recipe { then: None, ..options.recipe_as_written()? };
    let choices =
        serde_json::to_string(&own).map_err(|source| PipelineError::Json { what: "the recipe", source })?;
    let frame = options.frame.as_ref().map(|frame| {
        let text = serde_json::to_string(frame);
        text.map(|text| ("frame".to_owned(), text))
            .map_err(|source| PipelineError::Json { what: "the frame", source })
    });
    let mut fingerprint = adjustment_fingerprint(run);
    fingerprint.extend([
        ("--recipe".into(), recipe.name.clone()),
        ("content of the recipe".into(), hash(choices.as_bytes())),
        ("--iterations".into(), recipe.iterations.to_string()),
        ("--seed".into(), options.seed.to_string()),
    ]);
    fingerprint.extend(frame.transpose()?);
    if options.no_splats {
        fingerprint.insert("--no-splats".into(), "given".into());
    }
    if let Some(prediction) = prediction_of(run, &adjustment_fingerprint(run))? {
        fingerprint.insert("predicted splats".into(), prediction);
    } else if options.predict {
        fingerprint.insert("--start".into(), format!("predict, {}", Model::built_in_hash()));
    }
    Ok(fingerprint)
}
