//! A room whose cloud of points has holes.

use super::*;
use crate::prior::DepthKind;
use glam::{DMat3, DVec2};

/// The room's extent, metres.
const ROOM: DVec3 = DVec3::new(4.0, 5.0, 2.5);
/// Side of the cubes that are emptied or not, metres.
const HOLE_M: f64 = 0.6;

/// Cameras in the middle of the room that look around.
fn cameras() -> Vec<PinholeCamera> {
    let of = |k: u32| {
        let angle = f64::from(k) * std::f64::consts::TAU / 16.0;
        let forward =
            DVec3::new(angle.cos(), angle.sin(), if k.is_multiple_of(2) { 0.25 } else { -0.35 }).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let center = 0.5 * ROOM - 1.2 * forward.with_z(0.0);
        let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        let principal = DVec2::new(159.5, 119.5);
        PinholeCamera { cam_from_site, center, focal: DVec2::splat(260.0), principal, size: (320, 240) }
    };
    (0..16).map(of).collect()
}

/// Depth of the walls, floor and ceiling at a position in a view.
fn depth(camera: &PinholeCamera, col: f64, row: f64) -> f64 {
    let ray = DVec3::from_array(camera.ray(Pixel::<CenterPx>::new(col, row)));
    let to_far = ((ROOM.max(DVec3::ZERO) - camera.center) / ray).max(-camera.center / ray);
    to_far.min_element() * (camera.cam_from_site * ray).z
}

fn prior(camera: &PinholeCamera, kind: DepthKind) -> DepthPrior {
    let (width, height) = camera.size;
    let value = |col: usize, row: usize| {
        let warp = 1.0 + 0.1 * (col as f64 / 60.0).sin() * (row as f64 / 70.0).cos();
        let depth = warp * depth(camera, col as f64, row as f64);
        (if kind == DepthKind::Disparity { 3.0 / depth + 0.2 } else { 0.5 * depth + 1.0 }) as f32
    };
    DepthPrior { values: Grid2::from_fn(width, height, value), kind }
}

fn is_hole(p: DVec3) -> bool {
    let cube = (p / HOLE_M).floor();
    let item = cube.x as u64 + 100 * (cube.y as u64 + 100 * cube.z as u64);
    CounterRng::new(3, 0, 0, item).uniform() < 0.3
}

/// Points on walls, floor and ceiling every so many metres.
fn surface(every_m: f64) -> Vec<DVec3> {
    let mut all = Vec::new();
    for axis in 0..3 {
        let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
        let counts = [a, b].map(|k| (ROOM[k] / every_m) as usize);
        for (i, j) in (0..counts[0]).flat_map(|i| (0..counts[1]).map(move |j| (i, j))) {
            for at in [0.0, ROOM[axis]] {
                let mut p = DVec3::ZERO;
                (p[axis], p[a], p[b]) = (at, (i as f64 + 0.5) * every_m, (j as f64 + 0.5) * every_m);
                all.push(p);
            }
        }
    }
    all
}

fn start(kind: DepthKind, threads: usize) -> (usize, Vec<ScenePoint>, DenseSummary) {
    let kept = surface(0.05).into_iter().filter(|p| !is_hole(*p));
    let points: Vec<ScenePoint> =
        kept.map(|p| ScenePoint { position: Point::new(p.x, p.y, p.z), rgb: [0; 3] }).collect();
    let cameras = cameras();
    let priors: Vec<DepthPrior> = cameras.iter().map(|camera| prior(camera, kind)).collect();
    let view = |(camera, depth)| DenseView { camera, depth, color: Box::new(|_, _| Some([9, 8, 7])) };
    let views: Vec<DenseView> = cameras.iter().zip(&priors).map(view).collect();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let (all, summary) = pool.install(|| dense_start(&points, &views, 0.02, 1));
    (points.len(), all, summary)
}

/// Shares of the holes that the cameras see that have points again, and the median distance of added points to the room.
fn score(given: usize, all: &[ScenePoint]) -> (f64, f64) {
    let positions: Vec<[f64; 3]> = all.iter().map(|p| p.position.xyz()).collect();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(&positions).unwrap();
    let cameras = cameras();
    let is_seen = |p: &DVec3| {
        cameras.iter().any(|camera| {
            let px = camera.project(Point::new(p.x, p.y, p.z));
            px.is_some_and(|px| (5.0..314.0).contains(&px.col) && (5.0..234.0).contains(&px.row))
        })
    };
    let holes: Vec<DVec3> = surface(0.05).into_iter().filter(|p| is_hole(*p) && is_seen(p)).collect();
    let is_near = |p: &&DVec3| {
        tree.query(&p.to_array()).nearest_one::<SquaredEuclidean<f64>>().execute().distance.sqrt() < 0.05
    };
    let filled = holes.iter().filter(is_near).count() as f64 / holes.len() as f64;
    let distance = |p: &[f64; 3]| {
        let p = DVec3::from_array(*p);
        p.abs().min((ROOM - p).abs()).min_element()
    };
    (filled, quantile(positions[given..].iter().map(distance).collect(), 0.5).unwrap())
}

#[test]
fn holes_are_filled_within_two_centimetres_of_the_walls() {
    for kind in [DepthKind::Relative, DepthKind::Disparity] {
        let (given, all, summary) = start(kind, 2);
        let (filled, error_m) = score(given, &all);
        assert!(filled >= 0.8 && error_m <= 0.02, "{kind}: {filled} {error_m} {summary:?}");
        assert_eq!(summary.sparse, summary.filled + summary.without_points + summary.without_fit);
        assert_eq!(summary.added, all.len() - given);
        assert!(all[given..].iter().all(|p| p.rgb == [9, 8, 7]));
    }
}

#[test]
fn the_number_of_threads_does_not_change_the_points() {
    let [one, two] = [1, 2].map(|threads| start(DepthKind::Relative, threads).1);
    assert!(one == two);
}

#[test]
fn without_points_around_nothing_is_added() {
    let cameras = cameras();
    let prior = prior(&cameras[0], DepthKind::Metric);
    let view = DenseView { camera: &cameras[0], depth: &prior, color: Box::new(|_, _| Some([0; 3])) };
    let (points, summary) = dense_start(&[], &[view], 0.02, 1);
    assert!(points.is_empty() && summary.without_points == PATCHES * PATCHES && summary.added == 0);
}
