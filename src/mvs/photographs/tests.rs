//! Matching of photographs of a simulated room with a box in it.

use super::*;
use crate::frame::Pixel;
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::stats::quantile;
use glam::{DMat3, DVec2, DVec3};

const SIZE: (usize, usize) = (128, 96);
/// Side of the knots of the texture, metres.
const KNOT_M: f64 = 0.07;

/// Smooth noise from 0 to 1.
fn noise(p: DVec3) -> f64 {
    let p = p / KNOT_M;
    let (base, part) = (p.floor(), p - p.floor());
    let knot = |k: usize| {
        let corner = DVec3::new((k & 1) as f64, (k >> 1 & 1) as f64, (k >> 2 & 1) as f64);
        let at = (base + corner).to_array().map(|v| v as i64 as u64);
        let weight = (DVec3::ONE - corner - part).abs();
        weight.x * weight.y * weight.z * CounterRng::new(at[0], 1, at[1], at[2]).uniform()
    };
    (0..8).map(knot).sum()
}

/// Distance along a ray at which it enters or leaves a box; infinite if it misses it.
fn box_distance(from: DVec3, along: DVec3, low: DVec3, high: DVec3, is_inside: bool) -> f64 {
    let (a, b) = ((low - from) / along, (high - from) / along);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    match is_inside {
        true => leave,
        false if enter > 0.0 && enter < leave => enter,
        false => f64::INFINITY,
    }
}

/// The photograph of a camera, and its depths.
fn photograph(camera: PinholeCamera) -> (Photograph, Grid2) {
    let hit = |col: usize, row: usize| {
        let along = DVec3::from_array(camera.ray(Pixel::new(col as f64, row as f64)));
        let room =
            box_distance(camera.center, along, DVec3::new(-2.0, -1.2, -1.0), DVec3::new(2.0, 1.2, 3.0), true);
        let block =
            box_distance(camera.center, along, DVec3::new(-0.5, 0.2, 1.5), DVec3::new(0.1, 1.2, 2.0), false);
        camera.center + along * room.min(block)
    };
    let gray = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| noise(hit(col, row)) as f32);
    let depth = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| {
        (camera.cam_from_site * (hit(col, row) - camera.center)).z as f32
    });
    (Photograph::new(camera, gray), depth)
}

/// A camera near the origin that looks ahead.
fn camera(center: DVec3, turned: f64) -> PinholeCamera {
    PinholeCamera {
        cam_from_site: DMat3::from_rotation_y(turned),
        center,
        focal: DVec2::splat(100.0),
        principal: DVec2::new(63.5, 47.5),
        size: SIZE,
    }
}

fn cameras() -> Vec<PinholeCamera> {
    (0..5)
        .map(|k| {
            let x = 0.22 * (f64::from(k) - 2.0);
            camera(DVec3::new(x, 0.1 * f64::from(k % 2), 0.05 * f64::from(k % 3)), 0.12 * x)
        })
        .collect()
}

/// The share of pixels with a depth, and the median and the 95 % quantile of the errors, as shares of the depth.
fn errors(found: &Grid2, truth: &Grid2) -> (f64, f64, f64) {
    let errors: Vec<f64> =
        found.data.iter().zip(&truth.data).map(|(a, b)| f64::from(a / b - 1.0).abs()).collect();
    let known: Vec<f64> = errors.iter().copied().filter(|e| !e.is_nan()).collect();
    let at = |share| quantile(known.clone(), share).unwrap_or(f64::INFINITY);
    (known.len() as f64 / errors.len() as f64, at(0.5), at(0.95))
}

#[test]
fn depths_of_a_room_are_complete_and_exact() {
    let (views, truth): (Vec<_>, Vec<_>) = cameras().into_iter().map(photograph).unzip();
    let found = match_photographs(views.clone(), None, &NoProgress).unwrap();
    let cameras: Vec<PinholeCamera> = views.iter().map(|view| *view.camera()).collect();
    let depths: Vec<&Grid2> = found.iter().collect();
    let points = matched_points(&cameras, &depths, 2000);
    assert!((1000..4000).contains(&points.len()), "{}", points.len());
    let frames = |camera: &PinholeCamera, p: &MatchedPoint| {
        let px = camera.project(p.position);
        px.is_some_and(|px| (px.col - 63.5).abs() <= 64.0 && (px.row - 47.5).abs() <= 48.0)
    };
    let (beyond, seen): (Vec<&MatchedPoint>, Vec<&MatchedPoint>) =
        points.iter().partition(|p| cameras.iter().all(|camera| !frames(camera, p)));
    assert!(beyond.len() > 20 && beyond.len() * 2 < seen.len(), "{} {}", beyond.len(), seen.len());
    assert!(seen.iter().all(|p| frames(&cameras[p.view], p)), "the surface goes on where no view sees it");
    for (view, truth) in found.iter().zip(&truth) {
        let (complete, median, most) = errors(view, truth);
        // A pixel is about 4 % of the depth of the wall.
        assert!(complete > 0.7 && median < 0.008 && most < 0.03, "{complete} {median} {most}");
    }
}

#[test]
fn views_that_show_nothing_together_have_no_depths() {
    let one = photograph(camera(DVec3::ZERO, 0.0)).0;
    let same = match_photographs(vec![one.clone(), one.clone()], None, &NoProgress).unwrap();
    let alone = match_photographs(vec![one.clone()], None, &NoProgress).unwrap();
    let away = photograph(camera(DVec3::new(0.3, 0.0, 0.0), 2.5)).0;
    let apart = match_photographs(vec![one, away], None, &NoProgress).unwrap();
    for view in [same, alone, apart].concat() {
        assert!(view.data.iter().all(|z| z.is_nan()));
    }
    assert!(match_photographs(Vec::new(), None, &NoProgress).unwrap().is_empty());
}
