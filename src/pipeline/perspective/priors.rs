//! What is known of the surface that photographs show before they are trained: points to start from, depths and normals.

use super::super::PipelineError;
use super::super::predict::prediction_of;
use super::super::run_folder::perspective_fingerprint::perspective_fingerprint;
use super::super::scene_points::{start_points, starts_from_depths};
use super::super::train_options::TrainOptions;
use crate::frame::{Point, Site};
use crate::perspective::{Layout, PerspectiveScene, PerspectiveView};
use crate::prior::{
    PriorMaker, PriorSource, PriorSources, ViewPriors, bring_together, read_priors, sensor_priors,
    stereo_points,
};
use crate::progress::{Event, Progress};
use crate::run_files::PRIORS;
use crate::splat::loss::LossWeights;
use crate::splat::pinhole::WorkingFrame;
use crate::splat::recipe::{Recipe, StartPoints};
use rayon::prelude::*;
use std::path::Path;

/// Most points that matching gives to start from, about, and fewest pixels that must have a depth for a start from it.
const MOST_MATCHED: usize = 150_000;
const FEWEST_MATCHED: usize = 1000;

/// A scene without points and depth maps to start from, with points from its photographs; none for other scenes, and where matching
/// finds no surface.
pub(super) fn matched_scene(
    run: &Path,
    scene: &PerspectiveScene,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Option<PerspectiveScene>, PipelineError> {
    if !starts_from_matches(run, scene, options)? {
        return Ok(None);
    }
    let training: Vec<&PerspectiveView> = scene.training().collect();
    let stereo = PriorSource::Maker(PriorMaker::Stereo);
    let sources = PriorSources { depths: Some(stereo), ..PriorSources::default() };
    let priors = match read_priors(&sources, &training, &[], &run.join(PRIORS), progress) {
        Err(e) if e.is_of_maps() => Vec::new(),
        priors => priors?,
    };
    let depths = training.iter().zip(&priors);
    let depths: Vec<_> = depths.filter_map(|(view, prior)| Some((*view, prior.depth.as_ref()?))).collect();
    let matched: usize = depths.iter().map(|(_, depth)| depth.values.valid().count()).sum();
    if matched < FEWEST_MATCHED {
        let text =
            "the scene has no points, and its photographs do not match: training starts from random points";
        progress.event(Event::Warning(text.into()));
        return Ok(None);
    }
    let points = stereo_points(&depths, MOST_MATCHED)?;
    let text = format!(
        "the scene has no points: training starts from {} by matching of {} photographs",
        points.len(),
        depths.len()
    );
    progress.event(Event::Note(text));
    Ok(Some(PerspectiveScene { points, ..scene.clone() }))
}

/// Whether training starts from matching of the photographs: nothing else says where the surface is.
pub(super) fn starts_from_matches(
    run: &Path,
    scene: &PerspectiveScene,
    options: &TrainOptions,
) -> Result<bool, PipelineError> {
    let has_own = !scene.points.is_empty() || starts_from_depths(scene, options.reference_points);
    Ok(!has_own && prediction_of(run, &perspective_fingerprint(scene)?)?.is_none())
}

/// The priors of all training views, in the frame of training: those that are asked for, else, where the recipe uses them, what the
/// depth maps of RGB-D frames or matching of the photographs give. Says which loss terms are idle without them.
pub(super) fn priors(
    run: &Path,
    scene: &PerspectiveScene,
    frame: &WorkingFrame,
    options: &TrainOptions,
    progress: &dyn Progress,
) -> Result<Vec<ViewPriors>, PipelineError> {
    let sources = &prior_sources(scene, options)?;
    let working = &frame.enter(scene);
    let Recipe { weights, kind, .. } = options.perspective_recipe()?;
    let start = kind.start_points;
    let training: Vec<&PerspectiveView> = working.training().collect();
    let has_sensor = has_sensor(scene);
    // Nobody asked for matching: training does without it where it fails.
    let is_unasked = options.priors.depths.is_none() && sources.depths.is_some();
    let weighs = |name| weights.get(name) > 0.0;
    let uses_depths = sources.depths.is_none()
        && (weighs("depth_prior") || weighs("depth_smoothness") || start.needs_depths());
    let uses_normals = sources.normals.is_none() && weighs("normal_prior");
    if has_sensor && (uses_depths || uses_normals) {
        let what = match (uses_depths, uses_normals) {
            (true, true) => "depths and normals",
            (true, false) => "depths",
            (false, _) => "normals",
        };
        progress.event(Event::Note(format!("the scene's own depth maps are the prior of {what}")));
    } else {
        if is_unasked {
            let text = "without --depth-prior depths come from matching of the photographs";
            progress.event(Event::Note(text.into()));
        }
        say_what_is_missing(sources, &weights, start, progress);
    }
    let mut priors = vec![ViewPriors::default(); training.len()];
    let mut points = Vec::new();
    if sources.depths.is_some() || sources.normals.is_some() {
        // Files are in the unit of the scene.
        let of_scene: Vec<&PerspectiveView> = scene.training().collect();
        let unit = frame.unit();
        let positions = start_points(scene, unit, options.reference_points)?;
        let positions: Vec<Point<Site>> = positions.iter().map(|p| p.position).collect();
        let read = |sources| read_priors(sources, &of_scene, &positions, &run.join(PRIORS), progress);
        priors = match read(sources) {
            Err(e) if is_unasked && e.is_of_maps() => {
                progress.event(Event::Note(format!("{e}: training continues without depths")));
                read(&options.priors)?
            }
            priors => priors?,
        };
        let absolute = priors.iter_mut().filter_map(|prior| prior.depth.as_mut());
        for depth in absolute.filter(|depth| depth.kind.is_absolute()) {
            depth.values.data.iter_mut().for_each(|z| *z /= unit as f32);
        }
        points.extend(start_points(working, 1.0, options.reference_points)?.iter().map(|p| p.position));
    }
    if has_sensor && (uses_depths || uses_normals) {
        let total = training.len() as u64;
        progress.event(Event::Started { stage: "reading depth maps", total });
        let at_a_time = rayon::current_num_threads().max(1);
        let chunks = priors.chunks_mut(at_a_time).zip(training.chunks(at_a_time));
        for (k, (priors, views)) in chunks.enumerate() {
            progress.check()?;
            let own = views.par_iter().map(|view| match view.depth {
                Some(_) => sensor_priors(view, uses_normals),
                None => Ok(ViewPriors::default()),
            });
            for (prior, own) in priors.iter_mut().zip(own.collect::<Vec<_>>()) {
                let ViewPriors { depth, normal } = own?;
                prior.depth = prior.depth.take().or(depth.filter(|_| uses_depths));
                prior.normal = prior.normal.take().or(normal);
            }
            let done = total.min(((k + 1) * at_a_time) as u64);
            progress.event(Event::Advanced { done, status: String::new() });
        }
        progress.event(Event::Finished);
    }
    // With the normals of a sensor, if there are some.
    if sources.depths.is_some() && !start.aligns_depths() {
        bring_together(&mut priors, &training, &points, progress)?;
    }
    Ok(priors)
}

/// Where priors come from: what is asked for, else, for loss terms and starts that depths are made for, matching of the
/// photographs, unless a sensor has measured them.
pub(super) fn prior_sources(
    scene: &PerspectiveScene,
    options: &TrainOptions,
) -> Result<PriorSources, PipelineError> {
    let Recipe { weights, kind, .. } = options.perspective_recipe()?;
    let start = kind.start_points;
    let uses_depths = weights.get("depth_prior") > 0.0 || start == StartPoints::Patches;
    let mut sources = options.priors.clone();
    if sources.depths.is_none() && uses_depths && !has_sensor(scene) && scene.training().count() > 1 {
        sources.depths = Some(PriorSource::Maker(PriorMaker::Stereo));
    }
    Ok(sources)
}

/// Whether a sensor has measured depths. Depth maps of other layouts are references: those of LEVIR-NVS and of ScanNet++ are rendered
/// from models.
fn has_sensor(scene: &PerspectiveScene) -> bool {
    scene.layout == Layout::RgbD && scene.training().any(|view| view.depth.is_some())
}

/// Says what a recipe leaves out for lack of priors.
fn say_what_is_missing(
    sources: &PriorSources,
    weights: &LossWeights,
    start: StartPoints,
    progress: &dyn Progress,
) {
    if sources.depths.is_none() && start.needs_depths() {
        let text = match start {
            StartPoints::Patches => "without --depth-prior training starts from the points of the scene",
            _ => "without --depth-prior depths are interpolated between the points of the scene",
        };
        progress.event(Event::Note(text.into()));
    }
    for (source, weight, option) in [
        (&sources.depths, "depth_prior", "--depth-prior"),
        (&sources.normals, "normal_prior", "--normal-prior"),
    ] {
        if source.is_none() && weights.get(weight) > 0.0 {
            let text = format!("without {option} the recipe's loss term {weight} is left out");
            progress.event(Event::Note(text));
        }
    }
}
