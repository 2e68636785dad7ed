//! The splats that training of a perspective scene begins with.

use super::super::init::neighbour_scales;
use super::super::primitive::PrimitiveKind;
use super::super::splats::{Splats, rotation_to};
use super::view::PinholeView;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::perspective::{PinholeCamera, point_normals};
use crate::random::CounterRng;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::num::NonZero;

/// Initial opacity (3DGS).
const OPACITY: f32 = 0.1;
/// Smallest initial scale, working units (3DGS: a mean squared distance of 1e-7).
const SMALLEST: f64 = 3.2e-4;
/// Number of splats of a scene without points (3DGS, for synthetic scenes).
const RANDOM_SPLATS: u64 = 100_000;
/// Depths of those splats, as a multiple of the distance from the camera to the place that the cameras look at.
const DEPTHS: (f64, f64) = (0.3, 4.0);
/// Number of neighbours, the point itself among them, that give a disc its normal.
const NEIGHBOURS: NonZero<usize> = NonZero::new(9).unwrap();
/// Number of random depths on a ray, of which the one is taken where other views agree best.
const CANDIDATES: usize = 32;
/// Largest number of views that are compared.
const COMPARED_VIEWS: usize = 64;
/// Fewest other views that must see a place for a comparison.
const FEWEST_OTHERS: u32 = 2;
/// A place is empty if it is so in more than this share of the views that show it: the edges of cut-outs are not exact.
const EMPTY_SHARE: f64 = 0.1;
/// Greatest difference of colours that is told apart: beyond it something else may hide the place.
const GREATEST_DIFFERENCE: f32 = 0.2;
/// Purpose of the random numbers.
const DRAW_RAY: u64 = 20;

/// A splat at each point (working frame) of the point's colour (as displayed, 0 to 1), as large as the distances to its nearest
/// neighbours, with coefficients of spherical harmonics that are zero (3DGS). Discs lie in the planes of their neighbours.
#[must_use]
pub fn splats_at_points(points: &[(Point<Site>, [f32; 3])], primitive: PrimitiveKind) -> Splats {
    let positions: Vec<[f64; 3]> = points.iter().map(|p| p.0.xyz()).collect();
    let mut out = Splats::default();
    for ((position, rgb), scale) in points.iter().zip(neighbour_scales(&positions)) {
        let scale = if scale.is_finite() { scale.max(SMALLEST) } else { 1.0 };
        out.push(position.xyz().map(|v| v as f32), scale as f32, OPACITY, *rgb);
    }
    out.f_rest.resize(points.len(), [0.0; 45]);
    if primitive == PrimitiveKind::Disc {
        out.flatten();
        for (rotation, normal) in out.rotation.iter_mut().zip(point_normals(&positions, NEIGHBOURS)) {
            *rotation = rotation_to(normal).map(|v| v as f32);
        }
    }
    out
}

/// Splats of a scene without points: behind random pixels of the views, in the pixels' colours; of several random depths around
/// the place that the cameras look at, at the one where other views have that colour too.
#[must_use]
pub fn splats_on_rays(views: &[PinholeView], primitive: PrimitiveKind, seed: u64) -> Splats {
    let cameras: Vec<PinholeCamera> = views.iter().map(|v| v.camera).collect();
    let focus = focus(&cameras);
    let compared: Vec<&PinholeView> =
        views.iter().step_by(views.len().div_ceil(COMPARED_VIEWS).max(1)).collect();
    let point = |i: u64| {
        let mut draw = CounterRng::new(seed, DRAW_RAY, 0, i);
        let view = &views[draw.below(views.len())];
        let (width, height) = view.camera.size;
        let (col, row) = (draw.below(width), draw.below(height));
        let rgb = view.rgb(col, row)?.map(|v| f32::from(v) / 255.0);
        let ray = DVec3::from_array(view.camera.ray(Pixel::<CenterPx>::new(col as f64, row as f64)));
        let distance = view.camera.center.distance(focus);
        let (near, far) = (DEPTHS.0 * distance, DEPTHS.1 * distance);
        let candidates = (0..CANDIDATES).filter_map(|_| {
            // Even in the inverse of the depth, as are the images.
            let depth = 1.0 / (1.0 / near + draw.uniform() * (1.0 / far - 1.0 / near));
            let place = view.camera.center + depth * ray;
            let others = compared.iter().filter(|v| !std::ptr::eq(**v, view));
            Some((color_difference(others.copied(), place, rgb)?, place))
        });
        // The first of equal ones, as where no others see the place.
        let (_, place) = candidates.min_by(|a, b| a.0.total_cmp(&b.0))?;
        Some((Point::new(place.x, place.y, place.z), rgb))
    };
    let points: Vec<(Point<Site>, [f32; 3])> = (0..RANDOM_SPLATS).into_par_iter().filter_map(point).collect();
    splats_at_points(&points, primitive)
}

/// Mean difference between a colour and those that views show at a place; infinite if too few see the place, none if it is empty.
fn color_difference<'a>(
    views: impl Iterator<Item = &'a PinholeView>,
    place: DVec3,
    rgb: [f32; 3],
) -> Option<f32> {
    let (mut sum, mut count, mut empty) = (0.0, 0, 0);
    for view in views {
        let Some(px) = view.camera.project(Point::new(place.x, place.y, place.z)) else { continue };
        let (col, row) = (px.col.round(), px.row.round());
        let found = if col >= 0.0 && row >= 0.0 { view.color(col as usize, row as usize) } else { None };
        let Some(found) = found else { continue };
        if view.is_empty_at(col as usize, row as usize) {
            empty += 1;
            continue;
        }
        let difference = found.iter().zip(rgb).map(|(a, b)| (a - b).abs()).sum::<f32>() / 3.0;
        sum += difference.min(GREATEST_DIFFERENCE);
        count += 1;
    }
    if f64::from(empty) > EMPTY_SHARE * f64::from(empty + count) {
        return None;
    }
    Some(if count < FEWEST_OTHERS { f32::INFINITY } else { sum / count as f32 })
}

/// The place that is nearest to all optical axes, in the sense of least squares; of parallel axes one that lies ahead of the
/// cameras by the extent of the cameras.
#[must_use]
pub fn focus(cameras: &[PinholeCamera]) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.cam_from_site.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * camera.center;
    }
    let nearest = normal.inverse() * right;
    let is_ahead = |c: &&PinholeCamera| (c.cam_from_site * (nearest - c.center)).z > 0.0;
    if nearest.is_finite() && cameras.iter().filter(is_ahead).count() * 2 > cameras.len() {
        return nearest;
    }
    let count = cameras.len().max(1) as f64;
    let middle = cameras.iter().map(|c| c.center).sum::<DVec3>() / count;
    let axis = cameras.iter().map(|c| c.cam_from_site.row(2)).sum::<DVec3>() / count;
    middle + super::view::extent_m(cameras) * axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Grid2;
    use glam::DVec2;

    fn cameras_of(views: &[PinholeView]) -> Vec<PinholeCamera> {
        views.iter().map(|v| v.camera).collect()
    }

    #[test]
    fn splats_are_as_large_as_the_gaps_between_points() {
        let points: Vec<_> = (0..100)
            .map(|i| (Point::new(f64::from(i % 10) * 0.02, f64::from(i / 10) * 0.02, 0.0), [0.1, 0.2, 0.3]))
            .collect();
        let splats = splats_at_points(&points, PrimitiveKind::Ellipsoid);
        assert!((splats.log_scale[55][0].exp() - 0.02).abs() < 1e-4);
        assert!(splats.f_rest.len() == 100 && (splats.opacity_logit[0][0] + 9f32.ln()).abs() < 1e-4);
        assert_eq!(splats_at_points(&[], PrimitiveKind::Ellipsoid).len(), 0);
        assert!(splats_at_points(&points[..1], PrimitiveKind::Ellipsoid).log_scale[0][0].is_finite());
    }

    #[test]
    fn without_points_splats_lie_where_the_views_agree() {
        // Cameras on a circle of 4 m that look at a textured ball of 1 m around a place 1 m above its middle.
        let middle = DVec3::new(0.0, 0.0, 1.0);
        let view = |k: u32| {
            let (sin, cos) = (f64::from(k) * 0.7).sin_cos();
            let center = DVec3::new(4.0 * cos, 4.0 * sin, 1.0);
            let forward = DVec3::new(-cos, -sin, 0.0);
            let down = -DVec3::Z;
            let cam_from_site = DMat3::from_cols(down.cross(forward), down, forward).transpose();
            let (focal, principal) = (DVec2::splat(80.0), DVec2::splat(24.5));
            let camera = PinholeCamera { cam_from_site, center, focal, principal, size: (50, 50) };
            let color = |channel: usize, col: usize, row: usize| {
                let ray = DVec3::from_array(camera.ray(Pixel::new(col as f64, row as f64))).normalize();
                let to_middle = middle - center;
                let half_chord = (1.0 - to_middle.cross(ray).length_squared()).sqrt();
                let place = (to_middle.dot(ray) - half_chord) * ray - to_middle;
                (0.5 + 0.4 * (5.0 * place[channel]).sin()) as f32
            };
            // Rays that miss the ball have no data.
            let planes = [0, 1, 2].map(|channel| Grid2::from_fn(50, 50, |col, row| color(channel, col, row)));
            PinholeView::new(format!("{k}"), camera, &planes)
        };
        let views: Vec<_> = (0..9).map(view).collect();
        assert!(focus(&cameras_of(&views)).distance(middle) < 1e-9);
        let splats = splats_on_rays(&views, PrimitiveKind::Ellipsoid, 0);
        assert!(splats.len() > 20_000, "{}", splats.len());
        let distance = |p: &[f32; 3]| f64::from(p[0].hypot(p[1]).hypot(p[2] - 1.0));
        let on_ball = splats.position.iter().filter(|p| (distance(p) - 1.0).abs() < 0.2).count();
        assert!(on_ball * 10 > splats.len() * 6, "{on_ball} of {}", splats.len());
        let parallel: Vec<_> = (0..3).map(|_| view(0)).collect();
        assert!(focus(&cameras_of(&parallel)).is_finite());
    }
}
