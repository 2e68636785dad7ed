//! The second training of a run, of colours for novel views.

use crate::affine::{SiteScene, median_pixel_m};
use crate::io::write_json;
use crate::nn::features::{DenseFeatures, HandFeatures, OnnxFeatures};
use crate::nn::lpips::Lpips;
use crate::pipeline::run_folder::colors::hash_of_splats;
use crate::pipeline::run_folder::stage::{Fingerprint, Outcome, hash, hash_file};
use crate::pipeline::trained::TrainedColors;
use crate::pipeline::training_stage::{TrainingSoFar, TrainingStage};
use crate::pipeline::{PipelineError, TrainOptions, TrainedCameras};
use crate::progress::{Event, Progress};
use crate::run_files::{APPEARANCE, APPEARANCE_STAGE, CAMERAS, HEIGHT_SPLATS, SPLATS, STAGE, TRAIN_STAGE};
use crate::scene::{Role, Scene, TransferFunction};
use crate::splat::appearance::satgs::{AppearanceContent, Cube, Networks, TrainedAppearance, TrainedView};
use crate::splat::appearance::{Appearance, ModelParameters};
use crate::splat::loss::TermInputs;
use crate::splat::ply;
use crate::splat::recipe::{Recipe, SatelliteRecipe};
use crate::splat::satellite::{NovelView, SatelliteScene, SatelliteViews};
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;
use crate::splat::visibility::{PatchVisibility, VisibilityModel};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Networks of others that a training of colours uses.
pub struct OtherNetworks {
    /// The features by which images and pictures are compared.
    features: Box<dyn DenseFeatures>,
    /// The network of the perceptual loss; none without the loss.
    lpips: Option<Lpips<f32>>,
}

impl OtherNetworks {
    /// Reads the files that the options name.
    ///
    /// # Errors
    /// [`PipelineError`] of the file that cannot be used.
    pub fn read(options: &TrainOptions) -> Result<Self, PipelineError> {
        let features: Box<dyn DenseFeatures> = match &options.features {
            Some(path) => Box::new(OnnxFeatures::load(path)?),
            None => Box::<HandFeatures>::default(),
        };
        let lpips = options.lpips.as_deref().map(Lpips::read).transpose()?;
        Ok(Self { features, lpips })
    }
}

/// Trains colours for novel views by a recipe, from the splats of the training for heights, unless that was done with the
/// same input. Writes `RUN/appearance.safetensors`, and rewrites `RUN/splats.ply` in the colours of the reference view. The
/// caller holds the lock.
///
/// # Errors
/// [`PipelineError`]: an image is gone, a file cannot be written. When `progress` asks to stop, a checkpoint is written and the
/// error is [`PipelineError::TrainingInterrupted`].
pub fn train_locked(
    run: &Path,
    options: &TrainOptions,
    recipe: &Recipe<SatelliteRecipe>,
    networks: OtherNetworks,
    scene: &Scene,
    progress: &dyn Progress,
) -> Result<Outcome<TrainedColors>, PipelineError> {
    let fingerprint = fingerprint(run, options, recipe)?;
    // A training of heights may be resumed before that of colours has begun.
    let options = &TrainOptions { resume: false, ..options.clone() };
    let outputs = [APPEARANCE, SPLATS];
    let stage = TrainingStage::new(run, APPEARANCE_STAGE, &outputs, fingerprint, (options, progress));
    if stage.is_done()? {
        return Ok(Outcome::Kept(stage.summary()?));
    }
    stage.require_writable()?;
    let cameras = TrainedCameras::read(run)?;
    // Colours are trained as the images show them.
    let setup = SiteScene { transfer_function: TransferFunction::default(), ..cameras.setup.clone() };
    let views = Arc::new(setup.training_views(scene)?);
    let so_far = match stage.resume(views.len())? {
        Some(interrupted) => interrupted,
        None => {
            let splats = ply::read(&run.join(HEIGHT_SPLATS))?;
            TrainingSoFar::start(TrainingState::start(
                splats,
                recipe.kind.appearance,
                views.len(),
                options.seed,
            ))
        }
    };
    let schedule = Schedule {
        recipe: &recipe.clone().of_any(),
        views: views.len(),
        half_side_m: setup.half_side_m(),
        pixel_m: median_pixel_m(&views),
        splats_at_start: so_far.splats_at_start,
        is_gray: views.iter().all(|view| view.is_gray),
        seed: options.seed,
    };
    let cube = Cube::around(setup.area, setup.altitudes);
    let (altitudes, appearance) = (setup.altitudes, recipe.kind.appearance);
    let OtherNetworks { features, lpips } = networks;
    let visibility = recipe.kind.uncertainty.map(|u| VisibilityModel::new(features, u, views.len()));
    if lpips.is_none() && recipe.weights.get("perceptual") > 0.0 {
        let text = "without --lpips, colours are trained without the perceptual loss";
        progress.event(Event::Note(text.into()));
    }
    let inputs = TermInputs { prior: None, lpips };
    let satellite_scene =
        SatelliteScene { views: views.clone(), altitudes, inputs, appearance, cube, visibility };
    let model = SatelliteViews::new(satellite_scene, &so_far.state);
    let (model, so_far) = stage.train(model, &schedule, so_far, None)?;
    let trained = TrainedColors {
        iterations: recipe.iterations,
        seconds: so_far.seconds(),
        splats: so_far.state.splats.len(),
        l1: so_far.mean_of_last(views.len(), "l1"),
        ssim: so_far.mean_of_last(views.len(), "ssim"),
    };
    let state = &so_far.state;
    let visibility =
        (0..views.len()).map(|view| model.visibility(state, view)).collect::<Result<Vec<_>, _>>()?;
    write(run, &setup, scene, visibility, (cube, recipe), state)?;
    // The splats have the colours of the reference view now.
    let as_they_are = cameras.appearances.iter().map(|(name, _)| (name.clone(), Appearance::default()));
    write_json(&run.join(CAMERAS), &TrainedCameras { appearances: as_they_are.collect(), ..cameras })?;
    stage.complete(&trained)?;
    Ok(Outcome::Made(trained))
}

/// Writes the colour model, and the splats in the colours and under the sun of the reference view.
fn write(
    run: &Path,
    setup: &SiteScene,
    scene: &Scene,
    visibility: Vec<Option<PatchVisibility>>,
    (cube, recipe): (Cube, &Recipe<SatelliteRecipe>),
    made: &TrainingState,
) -> Result<(), PipelineError> {
    let acquired = |name: &str| scene.views.iter().find(|v| v.name == name)?.acquired.clone();
    let views = setup.views.iter().filter(|v| v.role == Role::Train).zip(&visibility);
    let views = views.map(|(v, visibility)| TrainedView {
        name: v.name.clone(),
        acquired: acquired(&v.name),
        sun: v.sun_shear.map(|shear| v.camera.direction_of(shear).map(|x| x as f32)),
        patch_px: visibility.as_ref().map(|v| v.patch_px),
    });
    let views: Vec<TrainedView> = views.collect();
    let embeddings: Vec<Vec<f32>> = made.appearances.iter().map(|(a, _)| a.values.clone()).collect();
    let reference = setup.reference_among_training();
    let parameters = ModelParameters { shared: &made.shared.values, view: &embeddings[reference] };
    let view = NovelView::from(&setup.views[setup.reference]);
    let mut model = recipe.kind.appearance.model(cube);
    let colors = view.splat_colors(&made.splats, model.as_mut(), parameters, setup.altitudes);
    let baked = made.splats.colored(&colors);
    let path = run.join(SPLATS);
    ply::write(&path, &baked, &setup.site)?;
    let content = AppearanceContent {
        networks: Networks::default(),
        cube,
        views,
        reference,
        splats: hash_of_splats(&path)?,
    };
    let (shared, colors) = (made.shared.values.clone(), made.splats.f_dc.clone());
    let visibility = visibility.into_iter().map(|v| v.map(|v| v.patches)).collect();
    let trained = TrainedAppearance { content, shared, embeddings, colors, visibility };
    Ok(trained.write(&run.join(APPEARANCE))?)
}

/// What the colours are made from; its keys are the names of options on the command line.
fn fingerprint(
    run: &Path,
    options: &TrainOptions,
    recipe: &Recipe<SatelliteRecipe>,
) -> Result<Fingerprint, PipelineError> {
    let choices =
        serde_json::to_string(recipe).map_err(|source| PipelineError::Json { what: "the recipe", source })?;
    let file = |path: &Option<PathBuf>| path.as_deref().map_or_else(|| "none".into(), hash_file);
    Ok(Fingerprint::from([
        ("--features".into(), file(&options.features)),
        ("--lpips".into(), file(&options.lpips)),
        ("training for heights".into(), hash_file(&run.join(TRAIN_STAGE).join(STAGE))),
        ("content of the recipe".into(), hash(choices.as_bytes())),
        ("--seed".into(), options.seed.to_string()),
    ]))
}
