//! What is left at the points after the global fit, interpolated to all pixels.
//!
//! The value at a pixel is the mean of those of the eight nearest points, weighted with `1 / (distance + a / 10)`, times
//! `exp(-d / L)`, with `d` the distance to the nearest point. `a` is the mean spacing of points, `sqrt(pixels / points)`, and `L` is
//! `4 a`: in pixels alone it would depend on the number of points. The paper interpolates between nearest neighbours and gives no
//! numbers; these were chosen on 7-Scenes.

use crate::io::Grid2;
use crate::stats::quantile;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use std::num::NonZero;

/// Neighbours whose values are mixed.
const NEIGHBOURS: NonZero<usize> = NonZero::new(8).unwrap();
/// Points that are off by more than this, and by more than so many standard deviations (1.4826 times the median), are wrong.
const GREATEST: f64 = 0.2;
const DEVIATIONS: f64 = 3.0 * 1.4826;
/// Neighbours, the point itself among them, with whose median a point is compared, and the largest difference.
const COMPARED: NonZero<usize> = NonZero::new(9).unwrap();
const GREATEST_DIFFERENCE: f64 = 0.1;
/// In mean spacings: the distance at which a weight halves, the decay, and the standard deviation of the smoothing.
const SOFTENING: f64 = 0.1;
const DECAY: f64 = 4.0;
const SMOOTHING: f64 = 0.25;
/// Share of the correction at a point that the pixels beside it take over, so that points make no spikes.
const BESIDE: f32 = 0.5;

/// The correction of all pixels.
pub(super) struct ResidualField {
    /// Logarithm of the factor of the depth of each pixel.
    pub planes: Grid2,
    /// The points (column, row) that agree with their neighbours.
    pub places: Vec<[f64; 2]>,
    /// At each of these points: the difference from what its neighbours alone would have given.
    pub left_out: Vec<f64>,
}

/// Mean spacing of points in a view, pixels.
pub(in crate::prior) fn mean_spacing((width, height): (usize, usize), points: usize) -> f64 {
    ((width * height) as f64 / points as f64).sqrt()
}

/// Interpolates values at points (column, row, logarithm of a ratio) of an image.
pub(super) fn residual_field(points: &[(f64, f64, f64)], (width, height): (usize, usize)) -> ResidualField {
    let zero =
        ResidualField { planes: Grid2::filled(width, height, 0.0), places: Vec::new(), left_out: Vec::new() };
    let Some(points) = agreeing(points).filter(|points| !points.is_empty()) else { return zero };
    let places: Vec<[f64; 2]> = points.iter().map(|p| [p.0, p.1]).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 2>::new_from_slice(&places) else { return zero };
    let spacing = mean_spacing((width, height), points.len());
    let mixed = |at: [f64; 2], skip: Option<usize>| {
        let wanted = NEIGHBOURS.saturating_add(usize::from(skip.is_some()));
        let near = tree.query(&at).nearest_n::<SquaredEuclidean<f64>>(wanted).execute();
        let near = near.iter().filter(|n| Some(n.item as usize) != skip);
        let (mut sum, mut weights, mut nearest) = (0.0, 0.0, f64::INFINITY);
        for n in near {
            let distance = n.distance.sqrt();
            let weight = 1.0 / (distance + SOFTENING * spacing);
            sum += weight * points[n.item as usize].2;
            weights += weight;
            nearest = nearest.min(distance);
        }
        if weights > 0.0 { sum / weights * (-nearest / (DECAY * spacing)).exp() } else { 0.0 }
    };
    let mut planes = Grid2::from_rows(width, height, |row, line| {
        for (col, value) in line.iter_mut().enumerate() {
            *value = mixed([col as f64, row as f64], None) as f32;
        }
    });
    smooth(&mut planes, SMOOTHING * spacing);
    for (col, row, value) in &points {
        let (col, row) = (col.round() as i64, row.round() as i64);
        for (dc, dr) in [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)] {
            let (c, r) = (col + dc, row + dr);
            if (0..width as i64).contains(&c) && (0..height as i64).contains(&r) {
                let field = &mut planes.data[r as usize * width + c as usize];
                let share = if (dc, dr) == (0, 0) { 1.0 } else { BESIDE };
                *field += share * (*value as f32 - *field);
            }
        }
    }
    let left_out = |(i, p): (usize, &(f64, f64, f64))| p.2 - mixed([p.0, p.1], Some(i));
    let left_out = points.par_iter().enumerate().map(left_out).collect();
    ResidualField { planes, places, left_out }
}

/// The points whose values are not far from zero, and near the median of those around.
fn agreeing(points: &[(f64, f64, f64)]) -> Option<Vec<(f64, f64, f64)>> {
    let limit = GREATEST.max(DEVIATIONS * quantile(points.iter().map(|p| p.2.abs()).collect(), 0.5)?);
    let points: Vec<_> = points.iter().filter(|p| p.2.abs() <= limit).copied().collect();
    let places: Vec<[f64; 2]> = points.iter().map(|p| [p.0, p.1]).collect();
    let tree = ImmutableKdTree::<f64, 2>::new_from_slice(&places).ok()?;
    let agrees = |p: &&(f64, f64, f64)| {
        let near = tree.query(&[p.0, p.1]).nearest_n::<SquaredEuclidean<f64>>(COMPARED).execute();
        let around = near.iter().map(|n| points[n.item as usize].2).collect();
        quantile(around, 0.5).is_some_and(|median| (p.2 - median).abs() <= GREATEST_DIFFERENCE)
    };
    Some(points.par_iter().filter(agrees).copied().collect())
}

/// Smooths with a Gaussian of this standard deviation, pixels; the border is continued.
fn smooth(plane: &mut Grid2, deviation: f64) {
    let reach = (3.0 * deviation).ceil() as i64;
    let weight = |k: i64| (-0.5 * (k as f64 / deviation.max(1e-6)).powi(2)).exp();
    let sum: f64 = (-reach..=reach).map(weight).sum();
    let kernel: Vec<f32> = (-reach..=reach).map(|k| (weight(k) / sum) as f32).collect();
    let (width, height) = (plane.width, plane.height);
    let inside = |at: i64, size: usize| at.clamp(0, size as i64 - 1) as usize;
    let across = Grid2::from_rows(width, height, |row, line| {
        let from = plane.row(row);
        for (col, out) in line.iter_mut().enumerate() {
            let at = |k: usize| from[inside(col as i64 + k as i64 - reach, width)];
            *out = kernel.iter().enumerate().map(|(k, w)| w * at(k)).sum();
        }
    });
    *plane = Grid2::from_rows(width, height, |row, line| {
        for (k, w) in kernel.iter().enumerate() {
            let from = across.row(inside(row as i64 + k as i64 - reach, height));
            line.iter_mut().zip(from).for_each(|(out, v)| *out += w * v);
        }
    });
}
