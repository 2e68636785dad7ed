//! Hierarchical depth alignment (GeoProp-GS §3.1, HDD): the prior of a view is brought to the depths of the points that the view
//! sees, first as a whole, then locally.
//!
//! 1. Scale and shift of all values, without outliers: of depths, or of inverse depths if the prior is a disparity. A shift of
//!    inverse depths cannot be made up for by one of depths.
//! 2. What is left at the points, as the logarithm of a ratio, is interpolated between them and multiplied in ([`field`]).
//!
//! The depths of all views then give a point for each pixel ([`cloud`]).

pub(super) mod cloud;
pub(super) mod field;
mod global;

use super::map::{DepthKind, DepthPrior};
use super::seen::SeenPoint;
use crate::io::Grid2;
use crate::stats::quantile;
use field::residual_field;
use global::global_fit;
use rayon::prelude::*;
use serde::Serialize;

/// Fewest points that a view must see for the alignment of its depths.
pub const FEWEST_POINTS: usize = 20;
/// A disparity gives no depth beyond that of the farthest point times this.
pub(super) const FARTHEST: f64 = 1.5;
/// The border of a view, as a share of its width, gets the median of the 5 x 5 pixels around.
const BORDER: f64 = 0.03;

/// How well a prior follows the points of a view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AlignmentQuality {
    /// Number of points with a value of the prior.
    pub points: usize,
    /// Median of the differences of depths at the points after the fit of scale and shift, as a share of the depth.
    pub global: f64,
    /// The same at points that local corrections did not use, each with its neighbours' correction.
    pub local: f64,
}

/// Why the prior of a view cannot be aligned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unaligned {
    /// The view sees too few points.
    FewPoints(usize),
    /// No scale and shift fit half of the points.
    NoFit,
}

/// The depths of a view by its prior.
#[derive(Clone, Debug)]
pub struct AlignedDepth {
    /// Depths along the optical axis, units of the scene; NaN where they are unknown.
    pub depth: Grid2,
    /// Natural logarithm of the factor by which the depths were corrected after the fit of scale and shift.
    pub correction: Grid2,
    /// Columns and rows, 0 at the centre of the first pixel, of the points from which the local corrections were made.
    pub places: Vec<[f64; 2]>,
    /// How well the depths follow the points.
    pub quality: AlignmentQuality,
}

#[cfg(test)]
impl AlignedDepth {
    /// Depths that were not corrected.
    pub(super) fn without_points(depth: Grid2) -> Self {
        let correction = Grid2::filled(depth.width, depth.height, 0.0);
        Self { depth, correction, places: Vec::new(), quality: AlignmentQuality::default() }
    }
}

/// The depths of a view by its prior, from the points that it sees.
pub(super) fn align_depth(prior: &DepthPrior, seen: &[SeenPoint]) -> Result<AlignedDepth, Unaligned> {
    let with_value = |p: &SeenPoint| {
        let value = f64::from(p.nearest(&prior.values));
        value.is_finite().then_some((*p, value))
    };
    let points: Vec<(SeenPoint, f64)> = seen.iter().filter_map(with_value).collect();
    if points.len() < FEWEST_POINTS {
        return Err(Unaligned::FewPoints(points.len()));
    }
    let pairs: Vec<(f64, f64)> =
        points.iter().map(|(p, value)| (*value, prior.kind.of_depth(p.depth))).collect();
    let fit = global_fit(&pairs).ok_or(Unaligned::NoFit)?;
    let farthest = FARTHEST * points.iter().map(|(p, _)| p.depth).fold(0.0, f64::max);
    let global = |value: f64| match prior.kind {
        DepthKind::Disparity => fit.apply(value).max(farthest.recip()).recip(),
        _ => fit.apply(value),
    };
    let ratio = |(p, value): &(SeenPoint, f64)| {
        let log_ratio = (p.depth / global(*value)).ln();
        log_ratio.is_finite().then_some((p.col, p.row, log_ratio))
    };
    let ratios: Vec<(f64, f64, f64)> = points.iter().filter_map(ratio).collect();
    let field = residual_field(&ratios, (prior.values.width, prior.values.height));
    let Grid2 { width, height, .. } = prior.values;
    let mut depth = Grid2::from_rows(width, height, |row, line| {
        for (col, depth) in line.iter_mut().enumerate() {
            let found = global(prior.values.at(col, row).into()) * f64::from(field.planes.at(col, row)).exp();
            *depth = if found > 0.0 { found as f32 } else { f32::NAN };
        }
    });
    smooth_border(&mut depth);
    let median = |values: Vec<f64>| quantile(values, 0.5).unwrap_or_default();
    let quality = AlignmentQuality {
        points: points.len(),
        global: median(ratios.iter().map(|(_, _, r)| r.exp_m1().abs()).collect()),
        local: median(field.left_out.iter().map(|r| r.exp_m1().abs()).collect()),
    };
    Ok(AlignedDepth { depth, correction: field.planes, places: field.places, quality })
}

/// Gives pixels near the border the median of those around: networks are least certain there.
fn smooth_border(depth: &mut Grid2) {
    let border = (BORDER * depth.width as f64).ceil() as usize;
    let is_border = |col: usize, row: usize| {
        col < border || row < border || col + border >= depth.width || row + border >= depth.height
    };
    let median = |i: usize| {
        let (col, row) = (i % depth.width, i / depth.width);
        if !is_border(col, row) || depth.data[i].is_nan() {
            return None;
        }
        let offsets = (-2..=2).flat_map(|dr| (-2..=2).map(move |dc| (dc, dr)));
        let around = offsets.map(|(dc, dr)| depth.get(col as i64 + dc, row as i64 + dr));
        quantile(around.filter(|v| v.is_finite()).map(f64::from).collect(), 0.5).map(|m| (i, m as f32))
    };
    let medians: Vec<(usize, f32)> = (0..depth.data.len()).into_par_iter().filter_map(median).collect();
    for (i, value) in medians {
        depth.data[i] = value;
    }
}

#[cfg(test)]
mod tests;
