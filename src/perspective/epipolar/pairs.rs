//! Which pairs of views are matched: those that see the same things from places not too near each other.

use super::super::pinhole::PinholeCamera;
use super::super::scene_parts::ScenePoint;
use crate::frame::{Pixel, Point, Site};
use crate::stats::median;
use glam::{DMat3, DVec3};

/// Positions along each side of an image at which it is looked whether another one sees the same.
const SAMPLES: usize = 4;
/// Least share of the samples that both images see.
const LEAST_SHARED: f64 = 0.25;
/// Angles at the scene between two lines of sight, degrees: below the first, errors of poses show little; above the second,
/// keypoints are seldom found again.
const NARROW_DEG: f64 = 4.0;
const WIDE_DEG: f64 = 25.0;
/// Largest number of the scene's points from which depths are taken.
const POINTS: usize = 500;
/// Without points, and where lines of sight do not meet: the depth over the distance of neighbouring cameras.
const DEPTH_OF_NEIGHBOURS: f64 = 5.0;

/// A usual depth of what each camera sees, in units of the scene.
pub(in crate::perspective) fn usual_depths(cameras: &[PinholeCamera], points: &[ScenePoint]) -> Vec<f64> {
    let step = points.len().div_ceil(POINTS).max(1);
    let some: Vec<Point<Site>> = points.iter().step_by(step).map(|p| p.position).collect();
    let seen = |camera: &PinholeCamera| {
        let inside =
            some.iter().filter(|p| camera.project(**p).is_some_and(|px| is_inside(camera, px.col, px.row)));
        median(inside.map(|p| camera.depth(*p)).collect())
    };
    let meeting = meeting_of_axes(cameras);
    let apart = neighbour_distance(cameras);
    let of = |camera: &PinholeCamera| {
        seen(camera)
            .or_else(|| meeting.map(|p| camera.depth(p)).filter(|depth| *depth > 0.0))
            .unwrap_or(DEPTH_OF_NEIGHBOURS * apart)
    };
    cameras.iter().map(of).collect()
}

/// The place nearest to all optical axes, if it is in front of most cameras.
fn meeting_of_axes(cameras: &[PinholeCamera]) -> Option<Point<Site>> {
    let (mut normal, mut right) = (DMat3::ZERO, DVec3::ZERO);
    for camera in cameras {
        let axis = camera.cam_from_site.row(2);
        let across = DMat3::IDENTITY - DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z);
        normal += across;
        right += across * camera.center;
    }
    let place = normal.inverse() * right;
    let place = Point::new(place.x, place.y, place.z);
    let in_front = cameras.iter().filter(|c| c.depth(place) > 0.0).count();
    (place.xyz().iter().all(|v| v.is_finite()) && 5 * in_front >= 4 * cameras.len()).then_some(place)
}

/// Median distance of a camera to the nearest one.
fn neighbour_distance(cameras: &[PinholeCamera]) -> f64 {
    let nearest = |a: &PinholeCamera| {
        let distances = cameras.iter().map(|b| a.center.distance(b.center));
        distances.filter(|d| *d > 0.0).min_by(f64::total_cmp)
    };
    median(cameras.iter().filter_map(nearest).collect()).unwrap_or(1.0)
}

fn is_inside(camera: &PinholeCamera, col: f64, row: f64) -> bool {
    let inside = |v: f64, n: usize| v >= -0.5 && v < n as f64 - 0.5;
    inside(col, camera.size.0) && inside(row, camera.size.1)
}

/// Share of samples of an image at a depth that another one sees.
fn share_seen(from: &PinholeCamera, depth: f64, by: &PinholeCamera) -> f64 {
    let at = |k: usize, n: usize| (k as f64 + 0.5) / SAMPLES as f64 * n as f64 - 0.5;
    let seen = (0..SAMPLES * SAMPLES).filter(|k| {
        let px = Pixel::new(at(k % SAMPLES, from.size.0), at(k / SAMPLES, from.size.1));
        let [x, y, z] = from.at_depth(px, depth);
        by.project(Point::new(x, y, z)).is_some_and(|px| is_inside(by, px.col, px.row))
    });
    seen.count() as f64 / (SAMPLES * SAMPLES) as f64
}

/// How well two views can be compared: above zero, at most one; zero for views that cannot.
fn suitability(a: (&PinholeCamera, f64), b: (&PinholeCamera, f64)) -> f64 {
    let shared = share_seen(a.0, a.1, b.0).min(share_seen(b.0, b.1, a.0));
    let middle = a.0.center + a.1 * a.0.cam_from_site.row(2);
    let angle_deg = (a.0.center - middle).angle_between(b.0.center - middle).to_degrees();
    if shared < LEAST_SHARED || angle_deg.is_nan() || angle_deg <= 0.0 {
        return 0.0;
    }
    shared * (angle_deg / NARROW_DEG).min(1.0) * (WIDE_DEG / angle_deg).min(1.0)
}

/// The views that can best be compared with each view, the best first.
pub(in crate::perspective) fn neighbours(
    cameras: &[PinholeCamera],
    depths: &[f64],
    most: usize,
) -> Vec<Vec<usize>> {
    let of = |i: usize| {
        let suits = |j: usize| (suitability((&cameras[i], depths[i]), (&cameras[j], depths[j])), j);
        let mut others: Vec<(f64, usize)> =
            (0..cameras.len()).filter(|j| *j != i).map(suits).filter(|(s, _)| *s > 0.0).collect();
        others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        others.into_iter().take(most).map(|(_, j)| j).collect()
    };
    (0..cameras.len()).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn camera(x: f64, turned_deg: f64) -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::from_rotation_y(turned_deg.to_radians()),
            center: DVec3::new(x, 0.0, 0.0),
            focal: DVec2::splat(100.0),
            principal: DVec2::splat(49.5),
            size: (100, 100),
        }
    }

    #[test]
    fn views_that_see_the_same_from_places_apart_are_compared() {
        let cameras =
            [camera(0.0, 0.0), camera(0.0, 0.0), camera(0.5, 0.0), camera(0.1, 0.0), camera(0.2, 180.0)];
        let found = neighbours(&cameras, &[5.0; 5], 3);
        assert_eq!(found[0], [2, 3]);
        assert!(found[4].is_empty());
    }

    #[test]
    fn without_points_the_depth_is_where_the_lines_of_sight_meet() {
        let around = [0.0, 20.0, 40.0].map(|deg: f64| {
            let looking = camera(0.0, deg);
            PinholeCamera { center: -4.0 * looking.cam_from_site.row(2), ..looking }
        });
        assert!(usual_depths(&around, &[]).iter().all(|d| (d - 4.0).abs() < 1e-6));
        let apart = [camera(0.0, 0.0), camera(1.0, 0.0)];
        assert!(usual_depths(&apart, &[]).iter().all(|d| (d - 5.0).abs() < 1e-9));
        let point = ScenePoint { position: Point::new(0.0, 0.0, 7.0), rgb: [0; 3] };
        assert!((usual_depths(&apart, &[point])[0] - 7.0).abs() < 1e-9);
    }
}
