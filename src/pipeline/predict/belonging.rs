//! Whether points of a file lie where a scene is: against the points that the scene itself knows, and in its images.

use crate::frame::Point;
use crate::perspective::PerspectiveScene;
use crate::pipeline::PipelineError;
use crate::progress::{Event, Progress};
use crate::stats::quantile;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;
use std::path::Path;

/// Numbers of points of a file that are looked for in images, and of points of the scene that are compared.
const SAMPLED: usize = 200_000;
const COMPARED: usize = 2_000;
/// Fewest points of a scene that tell its place.
const FEWEST: usize = 30;
/// The distance of the nearest quarter of the scene's points is compared: a file may cover a part of the scene only.
const NEAREST_PART: f64 = 0.25;
/// Distances of fewer spacings of the points than this are due to their spacing.
const LEAST_SPACINGS: f64 = 4.0;
/// Points that lie farther from the scene's, in pixels of its images, are warned of: colours are blurred; or refused: they are
/// of something else.
const BLURRED_PX: f64 = 8.0;
const ELSEWHERE_PX: f64 = 30.0;

/// A point that a scene knows, and how many pixels a unit of length is in the images there.
pub struct KnownPoint {
    pub place: [f64; 3],
    pub px_per_unit: f64,
}

/// Refuses points that no image shows, or that lie elsewhere than those of a perspective scene. With `keeps_place` the latter
/// is only said.
pub fn require_in_photographs(
    path: &Path,
    points: &[[f64; 3]],
    scene: &PerspectiveScene,
    keeps_place: bool,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let cameras: Vec<_> = scene.views.iter().map(|v| v.camera).collect();
    // Pixels for a unit of length where a camera has the point in its image.
    let seen = |p: &[f64; 3]| {
        cameras.iter().find_map(|c| {
            let px = c.project(Point::new(p[0], p[1], p[2]))?;
            let is_inside = (-0.5..c.size.0 as f64 - 0.5).contains(&px.col)
                && (-0.5..c.size.1 as f64 - 0.5).contains(&px.row);
            let depth = c.cam_from_site.row(2).dot(glam::DVec3::from_array(*p) - c.center);
            is_inside.then(|| c.focal.x / depth)
        })
    };
    let unit = if scene.is_metric() { "m" } else { "units" };
    let step = points.len().div_ceil(SAMPLED).max(1);
    if !points.par_iter().step_by(step).any(|p| seen(p).is_some()) {
        let own: Vec<[f64; 3]> = if scene.points.is_empty() {
            cameras.iter().map(|c| c.center.to_array()).collect()
        } else {
            scene.points.iter().map(|p| p.position.xyz()).collect()
        };
        let away = distance(middle(points), middle(&own));
        let reason =
            format!("no image shows one of them; their middle is {away:.4} {unit} from that of the scene");
        return Err(elsewhere(
            path,
            reason,
            "are their coordinates those of the scene: frame, unit, map, zone?",
        ));
    }
    let step = scene.points.len().div_ceil(COMPARED).max(1);
    let known = |p: [f64; 3]| seen(&p).map(|px_per_unit| KnownPoint { place: p, px_per_unit });
    let known: Vec<KnownPoint> =
        scene.points.iter().step_by(step).filter_map(|p| known(p.position.xyz())).collect();
    require_near(path, points, &known, unit, keeps_place, progress)
}

/// Refuses points that lie elsewhere than those that a scene knows. With `keeps_place` that is only said.
pub fn require_near(
    path: &Path,
    points: &[[f64; 3]],
    known: &[KnownPoint],
    unit: &str,
    keeps_place: bool,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let finite: Vec<[f64; 3]> = points.iter().filter(|p| p.iter().all(|v| v.is_finite())).copied().collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&finite).ok();
    let (Some(tree), true) = (tree, known.len() >= FEWEST) else { return Ok(()) };
    let nearest = |p: &[f64; 3]| tree.query(p).nearest_one::<SquaredEuclidean<f64>>().execute();
    let mut off: Vec<(f64, usize)> =
        known.par_iter().enumerate().map(|(i, k)| (nearest(&k.place).distance.sqrt(), i)).collect();
    off.sort_by(|a, b| a.0.total_cmp(&b.0));
    let rank = (NEAREST_PART * (off.len() - 1) as f64) as usize;
    let (distance, place) = off[rank];
    let px = distance * known[place].px_per_unit;
    if distance < LEAST_SPACINGS * spacing(&tree, &finite) || px < BLURRED_PX {
        return Ok(());
    }
    let ups = off[..=rank].iter().map(|(_, i)| {
        let there = nearest(&known[*i].place).item as usize;
        finite.get(there).map_or(0.0, |p| p[2] - known[*i].place[2])
    });
    let up = quantile(ups.collect(), 0.5).unwrap_or(0.0);
    let text = format!(
        "they lie {distance:.2} {unit} from the points that the scene itself has, or farther, {px:.0} pixels in its images \
         (upwards {up:+.2} {unit})"
    );
    if px >= ELSEWHERE_PX && !keeps_place {
        let cause = "are they of this scene, in its frame and unit, and their heights above the vertical reference that the \
                     file states? --keep-place takes them where they are";
        return Err(elsewhere(path, text, cause));
    }
    progress
        .event(Event::Warning(format!("the points of `{}` do not fit the scene: {text}", path.display())));
    Ok(())
}

fn elsewhere(path: &Path, reason: String, cause: &'static str) -> PipelineError {
    PipelineError::Elsewhere { what: format!("the points of `{}`", path.display()), reason, cause }
}

/// Typical distance of neighbouring points.
fn spacing(tree: &ImmutableKdTree<f64, 3>, points: &[[f64; 3]]) -> f64 {
    let next = |p: &[f64; 3]| {
        let two = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(NonZero::new(2)?).execute();
        Some(two.last()?.distance.sqrt())
    };
    let step = points.len().div_ceil(COMPARED).max(1);
    quantile(points.iter().step_by(step).filter_map(next).collect(), 0.5).unwrap_or(0.0)
}

fn middle(points: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|k| quantile(points.iter().map(|p| p[k]).collect(), 0.5).unwrap_or(0.0))
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    glam::DVec3::from_array(a).distance(glam::DVec3::from_array(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::Recorder;

    /// Points of a rolling surface, and some that the scene knows, moved upwards.
    fn check(up: f64, step: usize, keeps_place: bool) -> (Result<(), PipelineError>, usize) {
        let at = |i: usize| {
            let (x, y) = ((i % 100) as f64, (i / 100) as f64);
            [x, y, 5.0 * (0.1 * x).sin()]
        };
        let points: Vec<[f64; 3]> =
            (0..10_000).step_by(step).map(at).map(|[x, y, z]| [x, y, z + up]).collect();
        let known: Vec<KnownPoint> =
            (0..10_000).step_by(37).map(|i| KnownPoint { place: at(i), px_per_unit: 10.0 }).collect();
        let told = Recorder::default();
        let result = require_near(Path::new("cloud.laz"), &points, &known, "m", keeps_place, &told);
        let warnings = told.events().iter().filter(|e| matches!(e, Event::Warning(_))).count();
        (result, warnings)
    }

    #[test]
    fn points_above_those_of_the_scene_are_refused_with_their_distance() {
        assert!(matches!(check(0.0, 1, false), (Ok(()), 0)));
        assert!(matches!(check(1.0, 1, false), (Ok(()), 0)), "a metre is the spacing of the points");
        let refused = check(12.0, 1, false).0.unwrap_err().to_string();
        assert!(refused.contains("10.90 m from the points") && refused.contains("upwards +9"), "{refused}");
        assert!(matches!(check(12.0, 1, true), (Ok(()), 1)));
    }

    #[test]
    fn sparse_points_and_points_of_a_part_are_no_fault() {
        assert!(matches!(check(0.0, 61, false), (Ok(()), 0)));
    }
}
