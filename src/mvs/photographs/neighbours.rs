//! The source views of each view.

use crate::frame::{Pixel, Point, Site};
use crate::mvs::image::MatchImage;
use crate::mvs::ray_map::RayMap;
use crate::perspective::PinholeCamera;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Of each view the views with the nearest centres are looked at.
const CANDIDATES: NonZero<usize> = NonZero::new(128).unwrap();
/// Greatest angle between the optical axes of views that are matched, degrees.
const GREATEST_ANGLE_DEG: f64 = 60.0;
/// Ranks, by the distance of their centres, of the first source views.
const FIRST_RANKS: [usize; 4] = [0, 1, 3, 7];
/// Number of source views.
const SOURCES: usize = 5;
/// Points of a view, along each side, that tell what other views see.
const POINTS: usize = 20;
/// The angle between two lines of sight that matches best, degrees, and the standard deviations of the weights of smaller and of
/// greater ones: smaller ones tell less of the depth, greater ones change what is seen (as MVSNet, Yao et al. 2018).
const BEST_ANGLE_DEG: f64 = 8.0;
const SMALLER_DEG: f64 = 4.0;
const GREATER_DEG: f64 = 12.0;
/// A point that lies behind what the other view sees by more than this share of its depth is hidden.
const HIDDEN: f64 = 0.1;
/// Least weight of a source view, as a share of that of a view that sees all points under the best angle.
const LEAST_WEIGHT: f64 = 0.05;

/// For each view some views nearby that look in a similar direction, at several distances: how far the surface is nobody knows yet.
pub(super) fn first_sources(cameras: &[PinholeCamera]) -> Vec<Vec<usize>> {
    let of_view = |candidates: Vec<usize>| {
        let ranks = FIRST_RANKS.iter().filter_map(|rank| candidates.get(*rank).copied());
        let mut chosen: Vec<usize> = ranks.collect();
        // Few candidates: all of them.
        let more = candidates.into_iter().filter(|j| !chosen.contains(j));
        let more: Vec<usize> = more.take(FIRST_RANKS.len() - chosen.len()).collect();
        chosen.extend(more);
        chosen
    };
    nearby(cameras).into_iter().map(of_view).collect()
}

/// For each view those that see most of its surface under good angles, the best first. `maps` holds inverse depths of the images.
pub(super) fn best_sources(
    images: &[MatchImage<PinholeCamera>],
    maps: &[Option<&RayMap>],
) -> Vec<Vec<usize>> {
    let cameras: Vec<PinholeCamera> = images.iter().map(|image| image.camera).collect();
    let of_view = |(view, candidates): (usize, Vec<usize>)| {
        let points = maps[view].map_or(Vec::new(), |map| points(&cameras[view], map));
        let weight = |j: &usize| {
            let weights = points.iter().map(|p| weight(*p, &cameras[view], (&cameras[*j], maps[*j])));
            (*j, weights.sum::<f64>() / points.len().max(1) as f64)
        };
        let mut weights: Vec<(usize, f64)> = candidates.iter().map(weight).collect();
        weights.retain(|(_, weight)| *weight >= LEAST_WEIGHT);
        weights.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        weights.into_iter().take(SOURCES).map(|(j, _)| j).collect()
    };
    nearby(&cameras).into_par_iter().enumerate().map(of_view).collect()
}

/// For each view the others with the nearest centres that look in a similar direction, the nearest first.
pub(super) fn nearby(cameras: &[PinholeCamera]) -> Vec<Vec<usize>> {
    let centers: Vec<[f64; 3]> = cameras.iter().map(|c| c.center.to_array()).collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&centers).ok();
    let axis = |i: usize| cameras[i].cam_from_site.row(2);
    let least_cosine = GREATEST_ANGLE_DEG.to_radians().cos();
    let of_view = |i: usize| {
        let distance = |j: usize| cameras[i].center.distance_squared(cameras[j].center);
        let mut near: Vec<usize> = match &tree {
            Some(tree) => {
                let near = tree.query(&centers[i]).nearest_n::<SquaredEuclidean<f64>>(CANDIDATES).execute();
                near.iter().map(|n| n.item as usize).collect()
            }
            // Centres on a straight line along an axis fit into no tree.
            None => (0..cameras.len()).collect(),
        };
        near.retain(|j| *j != i && distance(*j) > 0.0 && axis(i).dot(axis(*j)) >= least_cosine);
        near.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
        near.truncate(CANDIDATES.get());
        near
    };
    (0..cameras.len()).into_par_iter().map(of_view).collect()
}

/// Points of the surface that a view sees, all over its image.
fn points(camera: &PinholeCamera, map: &RayMap) -> Vec<DVec3> {
    let (width, height) = (map.value.width, map.value.height);
    let at = |k: usize, count: usize| (2 * k + 1) * count / (2 * POINTS);
    let point = |k: usize| {
        let (col, row) = (at(k % POINTS, width), at(k / POINTS, height));
        let value = f64::from(map.value.get(col as i64, row as i64));
        let px = Pixel::new(col as f64, row as f64);
        (!value.is_nan()).then(|| DVec3::from_array(camera.at_depth(px, value.recip())))
    };
    (0..POINTS * POINTS).filter_map(point).collect()
}

/// What a point that a view sees tells of another view: 1 if that one sees it from as far under the best angle.
fn weight(p: DVec3, own: &PinholeCamera, (other, map): (&PinholeCamera, Option<&RayMap>)) -> f64 {
    let point = Point::<Site>::new(p.x, p.y, p.z);
    let Some(px) = other.project(point) else { return 0.0 };
    let is_inside = |v: f64, count: usize| v >= -0.5 && v < count as f64 - 0.5;
    if !is_inside(px.col, other.size.0) || !is_inside(px.row, other.size.1) {
        return 0.0;
    }
    // Comparisons with NaN are false: where nothing is known, nothing hides the point.
    let seen = map.map_or(f32::NAN, |map| map.value.get(px.col.round() as i64, px.row.round() as i64));
    if other.depth(point) * f64::from(seen) > 1.0 + HIDDEN {
        return 0.0;
    }
    let (a, b) = (p - own.center, p - other.center);
    let off_deg = a.angle_between(b).to_degrees() - BEST_ANGLE_DEG;
    let deviation = if off_deg < 0.0 { SMALLER_DEG } else { GREATER_DEG };
    let scale = (own.focal.x / a.length()) / (other.focal.x / b.length());
    scale.min(scale.recip()) * (-0.5 * (off_deg / deviation).powi(2)).exp()
}
