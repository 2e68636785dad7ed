//! What the training of a perspective scene starts from.

use super::super::predict::OF_PHOTOGRAPHS;
use super::super::scene_points::start_points;
use super::super::{PipelineError, TrainOptions, predict};
use super::start_pictures::write_pictures;
use crate::frame::{Point, Site};
use crate::perspective::{PerspectiveScene, PerspectiveView, ScenePoint};
use crate::predict::Predictor;
use crate::prior::{
    AlignedStart, AlignmentQuality, Completion, DenseSummary, DenseView, DepthPrior, FEWEST_POINTS,
    PixelColor, StartView, aligned_start, dense_start,
};
use crate::progress::{Event, Progress};
use crate::run_files::{PRIORS, START};
use crate::scene::Role;
use crate::splat::anchored::{Anchoring, StartSplats, nearest_anchors};
use crate::splat::pinhole::{PinholeView, splats_at_points, splats_on_rays};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::recipe::{PerspectiveRecipe, Recipe, StartPoints};
use crate::splat::splats::Splats;
use crate::stats::quantile;
use std::path::Path;

/// The box of the points leaves out this share at each side: a few float far away.
const OUTSIDE: f64 = 0.02;
/// Least distance of points of a dense start, as a share of the scene's diagonal.
const SPACING: f64 = 0.004;
/// Largest number of points of aligned depths: more take longer to train than they gain.
const MOST_ALIGNED: usize = 250_000;

/// Folder of filled pictures of pseudo-views, in that of priors.
const INPAINTED: &str = "inpainted";

/// The splats that training begins with: those that were predicted, else at the scene's points, else at those of its depth maps,
/// else at random; by priors of depths where the recipe has it so. All are in the working frame. Pictures of what priors gave go
/// to the folder of the run.
pub(super) fn splats_at_start(
    scene: &PerspectiveScene,
    predicted: Option<Splats>,
    views: &[PinholeView],
    recipe: &Recipe<PerspectiveRecipe>,
    options: &TrainOptions,
    run: &Path,
    progress: &dyn Progress,
) -> Result<StartSplats, PipelineError> {
    let seed = options.seed;
    if let Some(splats) = predicted {
        if let Some(start) = options.start {
            let found = format!("{start:?}").to_lowercase();
            let expected = "none: the run starts from its predicted splats";
            return Err(PipelineError::Option { option: "--start", found, expected });
        }
        return Ok(trainable(splats, recipe));
    }
    let points = start_points(scene, 1.0, options.reference_points)?;
    if points.is_empty() && scene.layout.has_reference_depths() {
        let text = "the scene has no points, and its depth maps are a reference: training starts from random points \
                    (--reference-points starts from the depth maps)";
        progress.event(Event::Note(text.into()));
    }
    if options.predict {
        let positions: Vec<[f64; 3]> = points.iter().map(|p| p.position.xyz()).collect();
        let made = predict::of_photographed_points(
            views,
            &positions,
            &Predictor::built_in()?,
            OF_PHOTOGRAPHS,
            progress,
        )?;
        return Ok(trainable(made.splats, recipe));
    }
    let start = recipe.kind.start_points;
    let has_depths = views.iter().any(|view| view.priors().depth().is_some());
    let has_enough = points.len() >= FEWEST_POINTS;
    let free = |points: &[ScenePoint]| splats_at_points(&colored(points), recipe.primitive).into();
    Ok(match start {
        _ if points.is_empty() => {
            if start.needs_depths() {
                let text = "the scene has no points to align depths with: training starts without depths";
                progress.event(Event::Warning(text.into()));
            }
            splats_on_rays(views, recipe.primitive, seed).into()
        }
        StartPoints::Patches if has_depths => free(&denser(points, views, seed, progress)),
        StartPoints::Hdd | StartPoints::Gva if has_depths || has_enough => {
            let folder = run.join(PRIORS).join(INPAINTED);
            let completion = match (start, &options.inpaint) {
                (StartPoints::Hdd, _) => Completion::None,
                (_, Some(command)) => Completion::Inpainted(command, &folder),
                (_, None) => Completion::PseudoViews,
            };
            let start = aligned(scene, &points, views, completion, progress)?;
            // A picture less is no reason to stop.
            if let Err(e) = write_pictures(&run.join(START), &start) {
                progress.event(Event::Warning(e.to_string()));
            }
            with_anchored(&start, recipe, matches!(completion, Completion::Inpainted(..)))
        }
        StartPoints::Scene | StartPoints::Patches | StartPoints::Hdd | StartPoints::Gva => free(&points),
    })
}

/// Predicted splats as training takes them: with coefficients of spherical harmonics that are zero, and flat if the recipe's are.
fn trainable(mut splats: Splats, recipe: &Recipe<PerspectiveRecipe>) -> StartSplats {
    splats.f_rest.resize(splats.len(), [0.0; 45]);
    if recipe.primitive == PrimitiveKind::Disc {
        splats.flatten();
    }
    splats.into()
}

/// Positions and colours.
fn colored(points: &[ScenePoint]) -> Vec<(Point<Site>, [f32; 3])> {
    points.iter().map(|p| (p.position, p.rgb.map(|v| f32::from(v) / 255.0))).collect()
}

/// The colours of a view for points.
fn color_of(view: &PinholeView) -> PixelColor<'_> {
    Box::new(|col, row| view.rgb(col, row))
}

/// Points by aligned depths of the views.
fn aligned(
    scene: &PerspectiveScene,
    points: &[ScenePoint],
    views: &[PinholeView],
    completion: Completion,
    progress: &dyn Progress,
) -> Result<AlignedStart, PipelineError> {
    let training: Vec<&PerspectiveView> = scene.training().collect();
    // Without any priors depths are interpolated between the points.
    let level: Vec<DepthPrior> = if views.iter().all(|view| view.priors().depth().is_none()) {
        views.iter().map(|view| DepthPrior::level(view.camera.size)).collect()
    } else {
        Vec::new()
    };
    let with_depth = training.into_iter().zip(views).enumerate().filter_map(|(i, (view, pixels))| {
        let depth = pixels.priors().depth().or_else(|| level.get(i))?;
        Some(StartView { view, depth, color: color_of(pixels) })
    });
    let with_depth: Vec<StartView> = with_depth.collect();
    let positions: Vec<Point<Site>> = points.iter().map(|p| p.position).collect();
    let others: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.role == Role::Test).collect();
    let start = aligned_start(&positions, &with_depth, &others, MOST_ALIGNED, completion, progress)?;
    let percent = |of: fn(&AlignmentQuality) -> f64| {
        100.0 * quantile(start.views.iter().map(|(_, v)| of(&v.quality)).collect(), 0.5).unwrap_or_default()
    };
    progress.event(Event::Note(format!(
        "depths of {} views are aligned: they differ from points by {:.2} % of the depth after the fit of scale and shift, by \
         {:.2} % from points that a local correction leaves out (medians); {} points",
        start.views.len(),
        percent(|q| q.global),
        percent(|q| q.local),
        start.points.len()
    )));
    if !matches!(completion, Completion::None) {
        let used = start.pseudo_views.iter().filter(|view| view.is_used).count();
        progress.event(Event::Note(format!(
            "{used} of {} pseudo-views have holes to fill; {} proposals where no view sees anything",
            start.pseudo_views.len(),
            start.proposals.len()
        )));
    }
    Ok(start)
}

/// Splats at the points, and at the proposals, each anchored to the splat nearest to it, with the colour of that one unless its own
/// was painted.
fn with_anchored(start: &AlignedStart, recipe: &Recipe<PerspectiveRecipe>, is_painted: bool) -> StartSplats {
    let mut splats = splats_at_points(&colored(&start.points), recipe.primitive);
    let reliable = start.points.len();
    let positions: Vec<[f64; 3]> = start.points.iter().map(|p| p.position.xyz()).collect();
    let of_proposals: Vec<[f64; 3]> = start.proposals.iter().map(|p| p.position.xyz()).collect();
    let Some(anchors) = nearest_anchors(&positions, &of_proposals) else { return splats.into() };
    let proposals = start.proposals.iter().zip(&anchors);
    let color = |p: &ScenePoint, anchor: usize| if is_painted { p.rgb } else { start.points[anchor].rgb };
    let proposals: Vec<ScenePoint> =
        proposals.map(|(p, a)| ScenePoint { position: p.position, rgb: color(p, *a) }).collect();
    let more = splats_at_points(&colored(&proposals), recipe.primitive);
    let anchoring = |(k, a): (usize, &usize)| Anchoring { splat: (reliable + k) as u32, anchor: *a as u32 };
    let anchorings = anchors.iter().enumerate().map(anchoring).collect();
    splats.append(more);
    StartSplats { splats, anchorings }
}

/// The points, and more where views with priors of depths see few.
fn denser(
    points: Vec<ScenePoint>,
    views: &[PinholeView],
    seed: u64,
    progress: &dyn Progress,
) -> Vec<ScenePoint> {
    let with_depth = views.iter().filter_map(|view| Some((view, view.priors().depth()?)));
    let dense: Vec<DenseView> = with_depth
        .map(|(view, depth)| DenseView { camera: &view.camera, depth, color: color_of(view) })
        .collect();
    progress.event(Event::Started { stage: "adding points where there are few", total: 0 });
    let (points, summary) = dense_start(&points, &dense, spacing_m(&points), seed);
    progress.event(Event::Finished);
    let DenseSummary { patches, sparse, filled, without_points, without_fit, added, residual } = summary;
    let fit = match dense.iter().all(|view| view.depth.kind.is_absolute()) {
        true => String::new(),
        false => format!(
            ", {:.2} % of the depth from those around; {without_points} are too far from points",
            100.0 * residual
        ),
    };
    progress.event(Event::Note(format!(
        "dense start: {sparse} of {patches} patches of views have few points; {added} points fill {filled} of them{fit}; \
         {without_fit} have an edge, no depths, or depths that do not fit"
    )));
    points
}

/// Least distance of points that are added: a share of the scene's diagonal without the outermost points.
fn spacing_m(points: &[ScenePoint]) -> f64 {
    let side = |axis: usize| {
        let values = || points.iter().map(|p| p.position.xyz()[axis]).collect();
        let at = |share: f64| quantile(values(), share).unwrap_or_default();
        at(1.0 - OUTSIDE) - at(OUTSIDE)
    };
    let diagonal = (0..3).map(|axis| side(axis).powi(2)).sum::<f64>().sqrt();
    (SPACING * diagonal).max(f64::MIN_POSITIVE)
}
