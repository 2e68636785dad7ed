//! Training of a satellite scene.

use super::super::predict::prediction_of;
use super::super::run_folder::satellite_cameras::require_images;
use super::super::run_folder::stage::{Fingerprint, Outcome, adjustment_fingerprint, hash};
use super::super::surface_source::{KnownSurface, SurfaceIsKnown};
use super::super::train_options::TrainOptions;
use super::super::trained::{Trained, mean};
use super::super::training_stage::{TrainingSoFar, TrainingStage};
use super::super::{PipelineError, TrainedCameras, read_scene, relocation};
use super::appearance::{self, OtherNetworks};
use super::device;
use super::training::Training;
use crate::affine::{SiteSceneError, median_pixel_m};
use crate::estimate::Imaging;
use crate::mvs::DSM_CELL_M;
use crate::predict::Model;
use crate::progress::{Event, Progress};
use crate::run_files::{CAMERAS, SPLATS, TRAIN_STAGE};
use crate::scene::Scene;
use crate::splat::appearance::satgs::Cube;
use crate::splat::loss::{Prior, TermInputs};
use crate::splat::recipe::{Recipe, SatelliteRecipe};
use crate::splat::satellite::SatelliteScene;
use crate::splat::train::Schedule;
use std::path::Path;
use std::sync::Arc;

/// Trains the satellite scene of a run: for heights, then for colours if the recipe has such a training. `surface_is_known` is called
/// when the heights are known before the splats are trained. The caller holds the lock.
pub fn train_locked(
    run: &Path,
    options: &TrainOptions,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    relocation::finish_locked(run)?;
    let scene = read_scene(run)?;
    let recipe = options.recipe_for(scene.training().count())?;
    let then = recipe.kind.then.clone();
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
    recipe: Recipe<SatelliteRecipe>,
    scene: &Scene,
    progress: &dyn Progress,
    surface_is_known: SurfaceIsKnown,
) -> Result<Outcome<Trained>, PipelineError> {
    let fingerprint = fingerprint(run, options, &recipe)?;
    let stage = TrainingStage::new(run, TRAIN_STAGE, &[SPLATS, CAMERAS], fingerprint, (options, progress));
    if stage.is_done()? {
        progress.event(Event::Note(format!("`{}` is trained already", run.display())));
        return Ok(Outcome::Kept(stage.summary()?));
    }
    stage.require_writable()?;
    require_images(scene)?;
    let mut training = Training::new(run, options, recipe, scene)?;
    let is_usual = training.recipe.name == Recipe::NAMES[0] && options.iterations.is_none();
    if is_usual && !options.no_splats {
        tell_expectation(&training, progress);
    }
    let views = Arc::new(training.setup.training_views(scene)?);
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let interrupted = stage.resume(views.len())?;
    let is_new = interrupted.is_none();
    if is_new {
        stage.remove_snapshots();
        training.match_surface(&views, progress)?;
    }
    // Read from the file whether or not training was interrupted, so that both give the same bytes.
    let first = training.first_surface()?;
    training.bound_altitudes(first.as_ref());
    let mut so_far = match interrupted {
        Some(interrupted) => interrupted,
        None => TrainingSoFar::start(training.state_at_start(&views, first.as_ref(), progress)?),
    };
    let mut device = None;
    if options.no_splats {
        stage.write_log(&[])?;
    } else {
        if let Some(heights) = first.as_ref().filter(|_| is_new && !training.refines_surface()) {
            let cameras = training.cameras(&so_far.state, &views, first.as_ref());
            surface_is_known(KnownSurface { cameras, splats: &so_far.state.splats, heights })?;
        }
        stage.write_cameras(&training.cameras(&so_far.state, &views, first.as_ref()))?;
        let (altitudes, appearance) = (training.setup.altitudes, training.recipe.kind.appearance);
        let prior = first.as_ref().map(|first| Arc::new(Prior::new(first)));
        let scene = || SatelliteScene {
            views: views.clone(),
            altitudes,
            inputs: TermInputs { prior: prior.clone(), lpips: None },
            appearance,
            cube: Cube::around(training.setup.area, altitudes),
            visibility: None,
        };
        let schedule = Schedule {
            recipe: &training.recipe.clone().of_any(),
            views: views.len(),
            half_side_m: training.setup.half_side_m(),
            pixel_m: median_pixel_m(&views),
            splats_at_start: so_far.splats_at_start,
            is_gray: views.iter().all(|view| view.is_gray),
            seed: options.seed,
        };
        let of_scene = (&views[..], &scene as &dyn Fn() -> SatelliteScene);
        let on = (options.device, progress);
        (so_far, device) = device::train_heights((&stage, &training), of_scene, &schedule, so_far, on)?;
    }
    let cameras = training.write(&so_far.state, &views, first.as_ref())?;
    let trained = Trained { device, ..summary(&cameras, &so_far) };
    stage.complete(&trained)?;
    training.forget_matching();
    Ok(Outcome::Made(trained))
}

fn summary(cameras: &TrainedCameras, so_far: &TrainingSoFar) -> Trained {
    let fits = &cameras.setup.views;
    let views = cameras.appearances.len();
    let of_images = |column| (!so_far.log.is_empty()).then(|| so_far.mean_of_last(views, column));
    Trained {
        iterations: so_far.log.len() as u32,
        seconds: so_far.seconds(),
        splats_start: so_far.splats_at_start,
        splats: so_far.state.splats.len(),
        camera_rms_px: Some(mean(fits.iter().map(|v| v.rms_px))),
        camera_max_px: Some(fits.iter().map(|v| v.max_px).fold(0.0, f64::max)),
        l1: of_images("l1"),
        ssim: of_images("ssim"),
        device: None,
        colors: None,
    }
}

/// Says which error, time and memory to expect of a training by the default recipe.
fn tell_expectation(training: &Training, progress: &dyn Progress) {
    let setup = &training.setup;
    let imaging = Imaging::of(setup);
    if imaging.views < 2 {
        return;
    }
    let ((west, south, east, north), (low, high)) = (setup.area, setup.altitudes);
    let whole = (1, [east - west, north - south]);
    let cost = imaging.cost(&training.recipe, whole, high - low, DSM_CELL_M);
    progress.event(Event::Note(imaging.text(cost)));
}

/// What a training is made from; its keys are the names of options on the command line.
fn fingerprint(
    run: &Path,
    options: &TrainOptions,
    recipe: &Recipe<SatelliteRecipe>,
) -> Result<Fingerprint, PipelineError> {
    // As written, so that another --iterations is not reported as a change of the whole recipe.
    // The training of colours that may follow is a stage of its own.
    let own = options.recipe_as_written()?.of_kind::<SatelliteRecipe>();
    let own = own.map(|own| Recipe { kind: SatelliteRecipe { then: None, ..own.kind.clone() }, ..own });
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
