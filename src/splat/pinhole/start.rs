//! The splats that training of a perspective scene begins with.

use super::super::init::neighbour_scales;
use super::super::splats::Splats;
use super::view::PinholeView;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::random::CounterRng;
use glam::{DMat3, DVec3};

/// Initial opacity (3DGS).
const OPACITY: f32 = 0.1;
/// Smallest initial scale, metres (3DGS: a mean squared distance of 1e-7).
const SMALLEST_M: f64 = 3.2e-4;
/// Number of splats of a scene without points (3DGS, for synthetic scenes).
const RANDOM_SPLATS: u64 = 100_000;
/// Depths of those splats, as a multiple of the distance from the camera to the place that the cameras look at.
const DEPTHS: (f64, f64) = (0.3, 4.0);
/// Purpose of the random numbers.
const DRAW_RAY: u64 = 20;

/// A splat at each point (site metres) of the point's colour (as displayed, 0 to 1), as large as the distances to its nearest
/// neighbours, with coefficients of spherical harmonics that are zero (3DGS).
#[must_use]
pub fn splats_at_points(points: &[(Point<Site>, [f32; 3])]) -> Splats {
    let positions: Vec<[f64; 3]> = points.iter().map(|p| p.0.xyz()).collect();
    let mut out = Splats::default();
    for ((position, rgb), scale) in points.iter().zip(neighbour_scales(&positions)) {
        let scale = if scale.is_finite() { scale.max(SMALLEST_M) } else { 1.0 };
        out.push(position.xyz().map(|v| v as f32), scale as f32, OPACITY, *rgb);
    }
    out.f_rest.resize(points.len(), [0.0; 45]);
    out
}

/// Splats of a scene without points: at random depths behind random pixels of the views, in the pixels' colours. The depths
/// are around the place that the cameras look at.
#[must_use]
pub fn splats_on_rays(views: &[PinholeView], seed: u64) -> Splats {
    let focus = focus(views);
    let point = |i: u64| {
        let mut draw = CounterRng::new(seed, DRAW_RAY, 0, i);
        let view = &views[draw.below(views.len())];
        let (width, height) = view.camera.size;
        let (col, row) = (draw.below(width), draw.below(height));
        let ray = DVec3::from_array(view.camera.ray(Pixel::<CenterPx>::new(col as f64, row as f64)));
        let distance = view.camera.center.distance(focus);
        let (near, far) = (DEPTHS.0 * distance, DEPTHS.1 * distance);
        // Even in the inverse of the depth, as are the images.
        let depth = 1.0 / (1.0 / near + draw.uniform() * (1.0 / far - 1.0 / near));
        let p = view.camera.center + depth * ray;
        Some((Point::new(p.x, p.y, p.z), view.color(col, row)?))
    };
    let points: Vec<(Point<Site>, [f32; 3])> = (0..RANDOM_SPLATS).filter_map(point).collect();
    splats_at_points(&points)
}

/// The place that is nearest to all optical axes, in the sense of least squares; of parallel axes one that lies ahead of the
/// cameras by the extent of the cameras.
fn focus(views: &[PinholeView]) -> DVec3 {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in views.iter().map(|v| &v.camera) {
        let axis = camera.cam_from_site.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * camera.center;
    }
    let nearest = normal.inverse() * right;
    let is_ahead = |v: &&PinholeView| (v.camera.cam_from_site * (nearest - v.camera.center)).z > 0.0;
    if nearest.is_finite() && views.iter().filter(is_ahead).count() * 2 > views.len() {
        return nearest;
    }
    let count = views.len().max(1) as f64;
    let middle = views.iter().map(|v| v.camera.center).sum::<DVec3>() / count;
    let axis = views.iter().map(|v| v.camera.cam_from_site.row(2)).sum::<DVec3>() / count;
    let cameras: Vec<_> = views.iter().map(|v| v.camera).collect();
    middle + super::view::extent_m(&cameras) * axis
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Grid2;
    use crate::perspective::PinholeCamera;
    use glam::DVec2;

    #[test]
    fn splats_are_as_large_as_the_gaps_between_points() {
        let points: Vec<_> = (0..100)
            .map(|i| (Point::new(f64::from(i % 10) * 0.02, f64::from(i / 10) * 0.02, 0.0), [0.1, 0.2, 0.3]))
            .collect();
        let splats = splats_at_points(&points);
        assert!((splats.log_scale[55][0].exp() - 0.02).abs() < 1e-4);
        assert!(splats.f_rest.len() == 100 && (splats.opacity_logit[0][0] + 9f32.ln()).abs() < 1e-4);
        assert_eq!(splats_at_points(&[]).len(), 0);
        assert!(splats_at_points(&points[..1]).log_scale[0][0].is_finite());
    }

    #[test]
    fn without_points_splats_lie_before_the_cameras_around_what_they_look_at() {
        // Cameras on a circle of 4 m that look at a place 1 m above its middle.
        let view = |k: u32| {
            let (sin, cos) = (f64::from(k) * 0.7).sin_cos();
            let center = DVec3::new(4.0 * cos, 4.0 * sin, 1.0);
            let forward = DVec3::new(-cos, -sin, 0.0);
            let down = -DVec3::Z;
            let cam_from_site = DMat3::from_cols(down.cross(forward), down, forward).transpose();
            let (focal, principal) = (DVec2::splat(50.0), DVec2::splat(24.5));
            let camera = PinholeCamera { cam_from_site, center, focal, principal, size: (50, 50) };
            let plane = Grid2::filled(50, 50, 0.25);
            PinholeView::new(format!("{k}"), camera, &[plane.clone(), plane.clone(), plane])
        };
        let views: Vec<_> = (0..9).map(view).collect();
        assert!(focus(&views).distance(DVec3::new(0.0, 0.0, 1.0)) < 1e-9);
        let splats = splats_on_rays(&views, 0);
        assert_eq!(splats.len(), RANDOM_SPLATS as usize);
        let near = splats.position.iter().filter(|p| p[0].hypot(p[1]) < 2.0).count();
        assert!(near > splats.len() / 4, "{near}");
        let parallel: Vec<_> = (0..3).map(|_| view(0)).collect();
        assert!(focus(&parallel).is_finite());
    }
}
