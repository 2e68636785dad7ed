//! Alignment of made priors, of those of 7-Scenes' sensor, and of networks.

use super::super::folder::PriorFolder;
use super::super::seen::seen_points;
use super::*;
use crate::io::ImageFile;
use crate::perspective::{PerspectiveOptions, PerspectiveScene};
use crate::random::CounterRng;
use std::path::PathBuf;

const SIZE: (usize, usize) = (160, 120);

/// Depths of a slanted plane with a step.
fn truth(col: f64, row: f64) -> f64 {
    2.0 + 0.01 * col + 0.005 * row + if col > 90.0 { 0.8 } else { 0.0 }
}

fn prior(kind: DepthKind, value: impl Fn(usize, usize) -> f64) -> DepthPrior {
    DepthPrior { values: Grid2::from_fn(SIZE.0, SIZE.1, |col, row| value(col, row) as f32), kind }
}

/// Points at random pixels; of each ten, `outliers` are wrong.
fn points(count: u64, outliers: u64) -> Vec<SeenPoint> {
    let of = |i: u64| {
        let mut draw = CounterRng::new(1, 0, 0, i);
        let (col, row) = (draw.below(SIZE.0) as f64, draw.below(SIZE.1) as f64);
        let wrong = if i % 10 < outliers { 1.5 + draw.uniform() } else { 1.0 };
        SeenPoint { index: i as usize, col, row, depth: wrong * truth(col, row) }
    };
    (0..count).map(of).collect()
}

fn largest_error(depth: &Grid2) -> f64 {
    let error = |i: usize| {
        let (col, row) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
        (f64::from(depth.data[i]) / truth(col, row) - 1.0).abs()
    };
    // The border has medians, which the step and the corners move.
    let inside = |i: &usize| {
        let (col, row) = (i % SIZE.0, i / SIZE.0);
        (5..SIZE.0 - 5).contains(&col) && (5..SIZE.1 - 5).contains(&row)
    };
    (0..depth.data.len()).filter(inside).map(error).fold(0.0, f64::max)
}

#[test]
fn priors_that_are_exact_up_to_scale_and_shift_give_exact_depths_among_outliers() {
    let relative = prior(DepthKind::Relative, |col, row| 0.4 * truth(col as f64, row as f64) + 0.3);
    let disparity = prior(DepthKind::Disparity, |col, row| 0.2 + 3.0 / truth(col as f64, row as f64));
    let metric = prior(DepthKind::Metric, |col, row| truth(col as f64, row as f64));
    for prior in [relative, disparity, metric] {
        let AlignedDepth { depth, quality, .. } = align_depth(&prior, &points(200, 3)).unwrap();
        assert!(largest_error(&depth) < 2e-3, "{:?} {}", prior.kind, largest_error(&depth));
        assert!(quality.points == 200 && quality.local < 1e-3, "{quality:?}");
    }
}

#[test]
fn depths_at_points_are_those_of_the_points() {
    let warped = prior(DepthKind::Relative, |col, row| {
        truth(col as f64, row as f64) * (1.0 + 0.08 * (col as f64 / 25.0).sin())
    });
    let points: Vec<SeenPoint> = points(150, 0)
        .into_iter()
        .filter(|p| p.col > 8.0 && p.col < 80.0 && p.row > 8.0 && p.row < 110.0)
        .collect();
    let AlignedDepth { depth, quality, .. } = align_depth(&warped, &points).unwrap();
    for p in &points {
        assert!((f64::from(p.nearest(&depth)) / p.depth - 1.0).abs() < 5e-3, "{p:?}");
    }
    assert!(quality.local < 0.5 * quality.global, "{quality:?}");
}

#[test]
fn priors_of_too_few_points_or_of_another_sign_are_not_aligned() {
    let depths = prior(DepthKind::Relative, |col, row| truth(col as f64, row as f64));
    assert_eq!(align_depth(&depths, &points(19, 0)).err().unwrap(), Unaligned::FewPoints(19));
    let opposite = prior(DepthKind::Disparity, |col, row| truth(col as f64, row as f64));
    assert_eq!(align_depth(&opposite, &points(200, 0)).err().unwrap(), Unaligned::NoFit);
}

/// A folder of the real data; says so when it is absent.
#[allow(clippy::print_stdout)]
fn data(name: &str) -> Option<PathBuf> {
    let here = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let folder = std::env::var_os("SATGS_DATA").map_or(here, PathBuf::from).join(name);
    if folder.exists() {
        return Some(folder);
    }
    println!("skipped: no {name} at {} (SATGS_DATA names another place)", folder.display());
    None
}

/// Depths of the sensor, and a prior of them: disparities from 0 to 1 with a smooth error of up to 10 % and a blur of 1.5 px.
fn sensor(folder: &std::path::Path, frame: usize) -> (Grid2, DepthPrior) {
    let file = ImageFile::open(&folder.join(format!("frame-{frame:06}.depth.png"))).unwrap();
    let mut depth = file.read(1).unwrap();
    depth.data.iter_mut().for_each(|v| *v = if *v > 0.0 && *v < 65535.0 { *v / 1000.0 } else { f32::NAN });
    let warp = |col: usize, row: usize| {
        1.0 + 0.1 * ((col as f64 / 130.0 + frame as f64).sin() * (row as f64 / 110.0 + 1.0).cos()) as f32
    };
    let disparity = Grid2::from_fn(depth.width, depth.height, |c, r| warp(c, r) / depth.at(c, r));
    let blurred = Grid2::from_fn(depth.width, depth.height, |col, row| {
        let offsets = (-4i64..=4).flat_map(|dr| (-4i64..=4).map(move |dc| (dc, dr)));
        let (mut sum, mut weights) = (0.0, 0.0);
        for (dc, dr) in offsets {
            let v = disparity.get(col as i64 + dc, row as i64 + dr);
            let w = (-0.5 * (dc * dc + dr * dr) as f32 / 2.25).exp();
            if v.is_finite() {
                (sum, weights) = (sum + w * v, weights + w);
            }
        }
        if disparity.at(col, row).is_finite() { sum / weights } else { f32::NAN }
    });
    let (low, high) = blurred.valid().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(v), h.max(v)));
    let mut values = blurred;
    values.data.iter_mut().for_each(|v| *v = (*v - low) / (high - low));
    (depth, DepthPrior { values, kind: DepthKind::Disparity })
}

#[test]
fn the_local_field_reaches_the_accuracy_that_was_measured_on_seven_scenes() {
    let Some(folder) = data("sevenscenes") else { return };
    // Median error in metres, with a tenth more than was measured when the constants were chosen.
    for (count, most) in [(150, 0.029), (600, 0.018), (2400, 0.013)] {
        let mut errors = Vec::new();
        for frame in [0, 200, 400, 600, 800] {
            let (depth, prior) = sensor(&folder, frame);
            let known: Vec<usize> = (0..depth.data.len()).filter(|i| depth.data[*i].is_finite()).collect();
            let point = |i: u64| {
                let mut draw = CounterRng::new(7, frame as u64, 0, i);
                let at = known[draw.below(known.len())];
                let outlier = if draw.uniform() < 0.05 { 0.5 + draw.uniform() } else { 1.0 };
                SeenPoint {
                    index: 0,
                    col: (at % depth.width) as f64,
                    row: (at / depth.width) as f64,
                    depth: f64::from(depth.data[at]) * (1.0 + 0.01 * draw.normal()) * outlier,
                }
            };
            let points: Vec<SeenPoint> = (0..count).map(point).collect();
            let AlignedDepth { depth: found, .. } = align_depth(&prior, &points).unwrap();
            let error = |i: &usize| f64::from((found.data[*i] - depth.data[*i]).abs());
            errors.extend(known.iter().filter(|i| found.data[**i].is_finite()).map(error));
        }
        let median = quantile(errors, 0.5).unwrap();
        assert!(median < 1.1 * most, "{count} points: {median} m");
    }
}

#[test]
fn points_that_were_left_out_are_nearer_after_the_local_field_of_neural_priors() {
    for (name, kind) in [("lightfield", DepthKind::Disparity), ("fox9", DepthKind::Relative)] {
        let Some(folder) = data("perspective").map(|f| f.join(name)) else { return };
        let scene = PerspectiveScene::read(&folder, &PerspectiveOptions::default()).unwrap();
        let priors = PriorFolder::open(&folder.join("depth")).unwrap();
        let points: Vec<_> = scene.points.iter().map(|p| p.position).collect();
        for view in &scene.views {
            let prior = priors.depth(&priors.file(view).unwrap(), view, kind).unwrap();
            let AlignedDepth { quality, .. } = align_depth(&prior, &seen_points(&points, view)).unwrap();
            assert!(quality.local < quality.global, "{name} {}: {quality:?}", view.name);
        }
    }
}
