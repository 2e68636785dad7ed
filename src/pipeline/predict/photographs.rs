//! Prediction of perspective scenes.

use super::belonging::require_in_photographs;
use super::points::read_points;
use super::splats::of_photographed_points;
use super::{OF_PHOTOGRAPHS, Output, PredictOptions, Predicted, read_model};
use crate::io::write_json;
use crate::perspective::PerspectiveScene;
use crate::pipeline::photographs::{read_views, require_own_images, tell_of_scene};
use crate::pipeline::run_folder::perspective_cameras::write_trained;
use crate::pipeline::run_folder::perspective_fingerprint::perspective_fingerprint;
use crate::pipeline::run_folder::stage::{Outcome, hash_file};
use crate::pipeline::scene_points::start_points;
use crate::pipeline::{PerspectiveManifest, PipelineError, TrainOptions};
use crate::progress::{Event, Progress};
use crate::run_files::{PREDICTED, PREDICTED_LIGHTS};
use crate::splat::appearance::Appearance;
use crate::splat::pinhole::WorkingFrame;
use crate::splat::ply;
use crate::splat::recipe::Recipe;
use std::path::Path;
use std::time::Instant;

/// As [`super::predict`], of the run of a perspective scene.
pub fn predict_run(
    run: &Path,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    let manifest = PerspectiveManifest::read(run)?;
    let scene = manifest.read_scene()?;
    predict(&manifest, &scene, out, options, progress)
}

/// As [`super::predict`], of a perspective scene.
pub fn predict_scene(
    path: &Path,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    let scene = PerspectiveScene::read(path, &options.perspective)?.near_origin();
    tell_of_scene(&scene, progress);
    predict(&PerspectiveManifest::new(path, &options.perspective, &scene), &scene, out, options, progress)
}

fn predict(
    manifest: &PerspectiveManifest,
    scene: &PerspectiveScene,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    let recipe = TrainOptions { recipe: Recipe::OF_PERSPECTIVE_SCENES.into(), ..TrainOptions::default() };
    let recipe = recipe.perspective_recipe()?;
    let file = options.points.as_deref();
    let mut made_from = perspective_fingerprint(scene)?;
    made_from.insert("--points".into(), file.map_or_else(|| "those of the scene".into(), hash_file));
    made_from.insert("--keep-place".into(), options.keeps_place.to_string());
    let is_flat = options.model.is_none() && options.without_network.is_none();
    let without_network = if is_flat { OF_PHOTOGRAPHS } else { options.without_network };
    let options = &PredictOptions { without_network, ..options.clone() };
    let (output, kept) = Output::open(out, made_from, options, progress)?;
    if let Some(kept) = kept {
        return Ok(kept);
    }
    if is_flat {
        let text = "the network that comes with satgs was trained on towns from above: splats of photographs are flat ones, without \
                    a network (--model takes one of `satgs learn --scenes`)";
        progress.event(Event::Note(text.into()));
    }
    let model = read_model(options)?;
    let frame = WorkingFrame::of(scene)?;
    let points = match file {
        Some(path) => {
            let points = read_points(path, scene.georeference.as_ref().map(|g| &g.grid))?;
            require_in_photographs(path, &points, scene, options.keeps_place, progress)?;
            points
        }
        None => start_points(scene, frame.unit(), false)?.iter().map(|p| p.position.xyz()).collect(),
    };
    let views = read_views(scene, progress)?;
    require_own_images(&manifest.scene, scene, &views, progress)?;
    let start = Instant::now();
    let made = of_photographed_points(&views, &points, &model, options.without_network, progress)?;
    let seconds = start.elapsed().as_secs_f64();
    output.clear()?;
    match scene.georeference.as_ref().map(|g| g.grid) {
        Some(site) => ply::write(&out.join(PREDICTED), &made.splats, &site)?,
        None => ply::write_local(&out.join(PREDICTED), &made.splats)?,
    }
    write_json(&out.join(PREDICTED_LIGHTS), &Vec::<(String, Appearance)>::new())?;
    manifest.write(out)?;
    write_trained(out, scene, &frame, &made.splats, recipe)?;
    let predicted = Predicted {
        points: file.map_or_else(|| "the scene".into(), |path| format!("`{}`", path.display())),
        clean_up: made.clean_up,
        spacing_m: made.spacing_m,
        splats: made.splats.len(),
        seconds,
    };
    output.complete(predicted, progress)
}
