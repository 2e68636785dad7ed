//! Splats predicted from points in one pass: `satgs predict`.

mod points;

use super::cameras::require_images;
use super::stage::{Fingerprint, Outcome, Stage, hash_file, or_none};
use super::{PipelineError, RunLock, TrainOptions, TrainedCameras, perspective, read_scene, relocation};
use crate::affine::{SiteScene, SiteSceneError, TrainingView};
use crate::bundle::Adjustment;
use crate::io::{WriteError, read_json, remove_if_there, write_json};
use crate::mvs::MatchedSurface;
use crate::predict::input::SeenCloud;
use crate::predict::light::{Light, calibrate};
use crate::predict::observer::SatelliteImages;
use crate::predict::{CleanUp, Cloud, Model, predict as predict_splats, reference};
use crate::progress::{Event, Progress};
use crate::run_files::{
    ADJUSTMENT, CAMERAS, FIRST_SURFACE, PREDICTED, PREDICTED_LIGHTS, SCENE, SPLATS, STAGE, SURFACE,
};
use crate::scene::Scene;
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::splat::splats::Splats;
use crate::splat::train::recipe::Recipe;
pub(super) use points::of_surface;
pub use points::{ENDINGS, PointSource};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Share of dropped points from which they look like those of something else.
const MANY_DROPPED: f64 = 0.15;

/// How to predict.
#[derive(Clone, Debug, Default)]
pub struct PredictOptions {
    /// File of points; by default the matched surface of the run, else its sparse points.
    pub points: Option<PathBuf>,
    /// File of a model; by default the one of the program.
    pub model: Option<PathBuf>,
    /// Make splats without a network, to compare with.
    pub without_network: Option<Untrained>,
    /// Replace a prediction that was made from other things.
    pub overwrite: bool,
}

/// Splats of points without a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Untrained {
    /// An isotropic one for each point.
    Isotropic,
    /// A flat one along the surface for each point.
    Flat,
}

/// Figures of a prediction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predicted {
    /// Where the points come from.
    pub points: String,
    /// What clean-up left of them.
    pub clean_up: CleanUp,
    /// Typical distance of the points, metres.
    pub spacing_m: f64,
    /// Number of splats.
    pub splats: usize,
    /// Seconds from the points to the splats.
    pub seconds: f64,
}

/// Predicts the splats of an adjusted run from points in one pass and writes them to the run folder `out`, which all commands take
/// that work on trained runs; `train` goes on from them.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted or is in use, the images are gone, there are too few points in the area, the model
/// or a file of points cannot be used, a file cannot be written, or `progress` asks to stop.
pub fn predict(
    run: &Path,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    let _lock = RunLock::existing(run)?;
    if perspective::is_run(run) {
        return Err(PipelineError::PredictOfPerspective { run: run.into() });
    }
    relocation::finish_locked(run)?;
    let scene = read_scene(run)?;
    let _out_lock = RunLock::make(out)?;
    let source = source_of(run, options);
    let stage = Stage::new(
        out,
        "predict",
        vec![out.join(SPLATS), out.join(CAMERAS)],
        fingerprint(run, options, &source),
    );
    if stage.is_done(options.overwrite)? {
        progress.event(Event::Note(format!("`{}` is predicted already", out.display())));
        return Ok(Outcome::Kept(stage.summary()?));
    }
    if out.join(SCENE).exists() && !out.join(PREDICTED).exists() {
        return Err(PipelineError::OtherRun { run: out.into() });
    }
    stage.require_writable()?;
    require_images(&scene)?;
    let model = match &options.model {
        Some(path) => Model::read(path)?,
        None => Model::built_in()?,
    };
    let (setup, recipe, sparse) = setup_of(run, &scene)?;
    let views = setup.training_views(&scene)?;
    if views.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let points = match &source {
        PointSource::File(path) => points::read_points(path, &setup.site)?,
        PointSource::Matched => points::of_surface(&MatchedSurface::read(&matched(run), &setup.site)?),
        PointSource::Sparse => {
            let note = "predicting from the sparse points, which are few: --points takes a surface model or a point cloud, and \
                        a run that was trained has a matched surface";
            progress.event(Event::Warning(note.into()));
            sparse
        }
    };
    let start = Instant::now();
    let made = of_points(&setup, &views, &points, &model, options.without_network, progress)?;
    let CleanUp { dropped, .. } = made.clean_up;
    if made.clean_up.dropped_share() > MANY_DROPPED {
        let percent = 100.0 * made.clean_up.dropped_share();
        progress.event(Event::Warning(format!(
            "{dropped} points ({percent:.0} %) are far from all others and were dropped: are the points of this area?"
        )));
    }
    let seconds = start.elapsed().as_secs_f64();
    copy_adjustment(run, out)?;
    // What was trained from an earlier prediction is replaced.
    remove_if_there(&out.join("train").join(STAGE))?;
    let names = views.iter().map(|v| v.name.clone());
    let appearances: Vec<(String, Appearance)> = names.zip(made.lights).collect();
    write_json(&out.join(PREDICTED_LIGHTS), &appearances)?;
    let cameras = TrainedCameras { appearances, setup, recipe, is_matched: false };
    cameras.write_splats(out, &made.splats)?;
    ply::write(&out.join(PREDICTED), &made.splats, &cameras.setup.site)?;
    write_json(&out.join(CAMERAS), &cameras)?;
    let predicted = Predicted {
        points: source.to_string(),
        clean_up: made.clean_up,
        spacing_m: made.spacing_m,
        splats: made.splats.len(),
        seconds,
    };
    stage.complete(&predicted)?;
    Ok(Outcome::Made(predicted))
}

/// The splats that a training of this run begins with if it was predicted; none if it was not.
pub(super) fn read_predicted(run: &Path) -> Result<Option<(Splats, Vec<Appearance>)>, PipelineError> {
    if !run.join(PREDICTED).exists() {
        return Ok(None);
    }
    let made_by = "`satgs predict RUN -o RUN2 --overwrite` makes it";
    let lights: Vec<(String, Appearance)> = read_json(&run.join(PREDICTED_LIGHTS))
        .map_err(|source| PipelineError::RunFile { source, made_by })?;
    let splats = ply::read(&run.join(PREDICTED))?;
    Ok(Some((splats, lights.into_iter().map(|(_, light)| light).collect())))
}

/// Splats of points, and the colour models of the views.
pub(super) struct SplatsOfPoints {
    pub splats: Splats,
    pub lights: Vec<Appearance>,
    clean_up: CleanUp,
    spacing_m: f64,
}

/// The splats of points (site frame, metres), by a model, or without one.
pub(super) fn of_points(
    setup: &SiteScene,
    views: &[TrainingView],
    points: &[[f64; 3]],
    model: &Model,
    untrained: Option<Untrained>,
    progress: &dyn Progress,
) -> Result<SplatsOfPoints, PipelineError> {
    let sampling = model.content.sampling;
    let (west, south, east, north) = setup.area;
    let (low, high) = setup.altitudes;
    let is_inside = |p: &&[f64; 3]| {
        (west..=east).contains(&p[0]) && (south..=north).contains(&p[1]) && (low..=high).contains(&p[2])
    };
    let inside: Vec<[f64; 3]> = points.iter().filter(is_inside).copied().collect();
    let (cloud, clean_up) = Cloud::new(&inside, sampling.spacing_m)?;
    let surface = reference::surface(&cloud, &sampling, setup.area, true);
    let images = SatelliteImages::new(views, &surface, setup.altitudes);
    let lights = calibrate(&images, cloud.positions(), setup.reference_among_training());
    let seen = SeenCloud::new(&cloud, &images, &lights);
    let splats = match untrained {
        Some(Untrained::Isotropic) => reference::isotropic(&seen),
        Some(Untrained::Flat) => reference::flattened(&seen),
        None => predict_splats(model, &seen, setup.area, true, progress)?,
    };
    let spacing_m = cloud.spacing_m();
    let lights = lights.iter().map(Light::appearance).collect();
    Ok(SplatsOfPoints { splats, lights, clean_up, spacing_m })
}

/// The surface that a training of the run has matched; the last one if there are several.
fn matched(run: &Path) -> PathBuf {
    let last = run.join(SURFACE);
    if last.exists() { last } else { run.join(FIRST_SURFACE) }
}

fn source_of(run: &Path, options: &PredictOptions) -> PointSource {
    match &options.points {
        Some(path) => PointSource::File(path.clone()),
        None if matched(run).exists() => PointSource::Matched,
        None => PointSource::Sparse,
    }
}

/// The training scene, a recipe for what follows, and the sparse points: those of a trained run are kept.
fn setup_of(run: &Path, scene: &Scene) -> Result<(SiteScene, Recipe, Vec<[f64; 3]>), PipelineError> {
    let adjustment = Adjustment::read(&run.join(ADJUSTMENT))?;
    let points = adjustment.positions();
    let recipe = TrainOptions::default().satellite_recipe()?;
    let setup = if run.join(CAMERAS).exists() {
        TrainedCameras::read(run)?.setup
    } else {
        let mut setup = SiteScene::new(scene, &adjustment.cameras_of(scene)?, &points)?;
        setup.transfer_function = setup.transfer_function.with_white(recipe.white);
        setup
    };
    let sparse = setup.sparse(&points).iter().map(|p| p.xyz()).collect();
    Ok((setup, recipe, sparse))
}

/// Copies what `train` and `dsm` read of an adjusted run.
fn copy_adjustment(run: &Path, out: &Path) -> Result<(), PipelineError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |e: std::io::Error| WriteError::new(&path, e)
    };
    let copy = |from: &Path, to: &Path| std::fs::copy(from, to).map(drop).map_err(failed(to));
    copy(&run.join(SCENE), &out.join(SCENE))?;
    let mut folders = vec![PathBuf::from(ADJUSTMENT)];
    while let Some(folder) = folders.pop() {
        let (from, to) = (run.join(&folder), out.join(&folder));
        std::fs::create_dir_all(&to).map_err(failed(&to))?;
        for entry in std::fs::read_dir(&from).map_err(failed(&from))? {
            let entry = entry.map_err(failed(&from))?;
            let name = folder.join(entry.file_name());
            if entry.path().is_dir() {
                folders.push(name);
            } else {
                copy(&entry.path(), &out.join(&name))?;
            }
        }
    }
    Ok(())
}

/// What a prediction is made from.
fn fingerprint(run: &Path, options: &PredictOptions, source: &PointSource) -> Fingerprint {
    let points = match source {
        PointSource::File(path) => hash_file(path),
        PointSource::Matched => hash_file(&matched(run)),
        PointSource::Sparse => "the sparse points".into(),
    };
    let model = options.model.as_deref().map_or_else(|| "the model of the program".into(), hash_file);
    let untrained = options.without_network.map(|kind| match kind {
        Untrained::Isotropic => "isotropic",
        Untrained::Flat => "flat",
    });
    Fingerprint::from([
        ("adjustment".into(), hash_file(&run.join(ADJUSTMENT).join(STAGE))),
        ("--points".into(), points),
        ("--model".into(), model),
        ("--without-network".into(), or_none(untrained)),
    ])
}
