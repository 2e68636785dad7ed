//! Agreement with a depth prior (IndoorSplat, equation 13): the expected depths `D` of a view are correlated with those of the
//! prior, and even.
//!
//! Over the `n` pixels with an opacity above one half and a value `y` of the prior, the first part is `1 - r` with Pearson's
//! correlation `r = S_xy / sqrt(S_xx S_yy)` of `x = D` and `y`, `S` being the sums of products of deviations from the means; so
//! scale and shift of the prior are free. Of a disparity, `x` is `1 / D`. The derivative of the part by `x` is
//! `-(y' - x' S_xy / S_xx) / sqrt(S_xx S_yy)`, with deviations `x'` and `y'`. Where all `x` or all `y` are equal, it is zero.
//!
//! The second part is the sum of `|D(u + 1, v) - D(u, v)| + |D(u, v + 1) - D(u, v)|` over pairs of these pixels, divided by `n`,
//! in metres.

use super::normal_consistency::OPACITY_OFFSET;
use super::term::{LossTerm, Rendered, Scaled, TermInfo};
use super::terms::TermInputs;
use crate::io::Grid2;
use crate::prior::DepthKind;
use crate::simd::SimdReal;
use crate::splat::raster::{Image, channel, disc_plane};
use rayon::prelude::*;

/// Weights and columns of the two parts.
pub const INFO: TermInfo = TermInfo {
    weights: &["depth_prior", "depth_smoothness"],
    columns: &["depth_prior", "depth_smoothness_m"],
};
/// Pixels with a smaller opacity are not compared.
pub(super) const LEAST_OPACITY: f64 = 0.5;
/// Without a greater mean square of the deviations, values count as equal.
const LEAST_VARIANCE: f64 = 1e-12;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct DepthPriorAgreement<T> {
    by_view: Image<T>,
    /// Expected depth of each pixel that is compared; zero elsewhere. Sums need f64.
    depth: Vec<f64>,
    is_evaluated: bool,
}

impl<T: SimdReal> DepthPriorAgreement<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

/// What the prior's values are correlated with.
fn compared(depth: f64, kind: DepthKind) -> f64 {
    if kind == DepthKind::Disparity { depth.recip() } else { depth }
}

/// Pearson's correlation of two quantities.
struct Correlation {
    means: [f64; 2],
    s_xy: f64,
    s_xx: f64,
    /// `sqrt(S_xx S_yy)`.
    norm: f64,
}

impl Correlation {
    /// Of the pairs (x, y) of each row that `pairs` lists; none if all x or all y are equal. Sums are of rows, in their order,
    /// so that they do not depend on the number of threads.
    fn of<I: Iterator<Item = (f64, f64)>>(rows: usize, pairs: impl Fn(usize) -> I + Sync) -> Option<Self> {
        let sum = |of: &(dyn Fn(f64, f64) -> [f64; 3] + Sync)| -> [f64; 3] {
            let add = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
            let of_row = |row| pairs(row).fold([0.0; 3], |sum, (x, y)| add(sum, of(x, y)));
            let sums: Vec<_> = (0..rows).into_par_iter().map(of_row).collect();
            sums.into_iter().fold([0.0; 3], add)
        };
        let [n, x, y] = sum(&|x, y| [1.0, x, y]);
        let means = [x / n, y / n];
        let [s_xx, s_xy, s_yy] = sum(&|x, y| {
            let (x, y) = (x - means[0], y - means[1]);
            [x * x, x * y, y * y]
        });
        let has_spread = n > 0.0 && s_xx.min(s_yy) >= LEAST_VARIANCE * n;
        has_spread.then(|| Self { means, s_xy, s_xx, norm: (s_xx * s_yy).sqrt() })
    }

    fn value(&self) -> f64 {
        self.s_xy / self.norm
    }

    fn by_x(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.means[0], y - self.means[1]);
        (y - x * self.s_xy / self.s_xx) / self.norm
    }
}

impl<T: SimdReal> LossTerm<T> for DepthPriorAgreement<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        self.is_evaluated = false;
        let has_weight = weights.iter().any(|weight| *weight > 0.0);
        let priors = rendered.priors.filter(|_| rendered.discs.is_some() && has_weight);
        let Some(prior) = priors.and_then(|priors| priors.depth.as_ref()) else { return 0.0 };
        let (view, kind, values) = (rendered.view, prior.kind, &prior.values);
        let pixels = self.find_depths(view, values);
        let (width, depth) = (view.width, &self.depth);
        let correlation = Correlation::of(view.height, |row| {
            let places = row * width..(row + 1) * width;
            let known = places.filter(|i| depth[*i] > 0.0);
            known.map(|i| (compared(depth[i], kind), f64::from(values.data[i])))
        });
        let by_correlation = |i: usize| {
            let inner = if kind == DepthKind::Disparity { -depth[i].powi(-2) } else { 1.0 };
            let by_x = |c: &Correlation| c.by_x(compared(depth[i], kind), values.data[i].into());
            correlation.as_ref().map_or(0.0, |c| -weights[0] * by_x(c) * inner)
        };
        let per_pixel = 1.0 / pixels.max(1) as f64;
        let planes = view.channels;
        self.by_view.resize(width, view.height, planes);
        let rows = self.by_view.data.par_chunks_mut(planes * width).enumerate();
        let differences: Vec<f64> = rows
            .map(|(row, by)| {
                by.fill(T::zero());
                let through = view.row(disc_plane::TRANSMITTANCE, row);
                let mut sum = 0.0;
                for col in (0..width).filter(|col| depth[row * width + col] > 0.0) {
                    let i = row * width + col;
                    let (after, slope) = differences(depth, width, col, i);
                    sum += after;
                    let by_depth = by_correlation(i) + weights[1] * per_pixel * slope;
                    let per_opacity = by_depth / (1.0 - through[col].as_f64() + OPACITY_OFFSET);
                    by[channel::DEPTH * width + col] = T::from_f64(per_opacity);
                    by[disc_plane::TRANSMITTANCE * width + col] = T::from_f64(per_opacity * depth[i]);
                }
                sum
            })
            .collect();
        columns[0] = correlation.as_ref().map_or(0.0, |c| 1.0 - c.value());
        columns[1] = differences.iter().sum::<f64>() * per_pixel;
        self.is_evaluated = true;
        weights[0] * columns[0] + weights[1] * columns[1]
    }

    fn by_view(&self) -> Option<Scaled<'_, T>> {
        self.is_evaluated.then_some(Scaled { image: &self.by_view, factor: T::one() })
    }
}

impl<T: SimdReal> DepthPriorAgreement<T> {
    /// Computes the expected depths of the pixels that are compared; returns how many there are.
    fn find_depths(&mut self, view: &Image<T>, prior: &Grid2) -> usize {
        let width = view.width;
        self.depth.resize(width * view.height, 0.0);
        let rows = self.depth.par_chunks_mut(width).zip(prior.data.par_chunks(width)).enumerate();
        rows.map(|(row, (out, prior))| {
            let (sums, through) = (view.row(channel::DEPTH, row), view.row(disc_plane::TRANSMITTANCE, row));
            let pixels = out.iter_mut().zip(prior).zip(sums.iter().zip(through));
            pixels.fold(0, |count, ((out, prior), (sum, through))| {
                let opacity = 1.0 - through.as_f64();
                let depth = sum.as_f64() / (opacity + OPACITY_OFFSET);
                let is_compared = opacity > LEAST_OPACITY && depth > 0.0 && prior.is_finite();
                *out = if is_compared { depth } else { 0.0 };
                count + usize::from(is_compared)
            })
        })
        .sum()
    }
}

/// Sum of the absolute differences from the pixel `i` of column `col` to those right of it and below it, and the derivative by
/// its depth of these differences and of those to it from left and above.
fn differences(depth: &[f64], width: usize, col: usize, i: usize) -> (f64, f64) {
    let right = if col + 1 < width { depth.get(i + 1) } else { None };
    let left = if col > 0 { depth.get(i - 1) } else { None };
    let above = i.checked_sub(width).and_then(|i| depth.get(i));
    let to = |neighbour: Option<&f64>| neighbour.filter(|z| **z > 0.0).map_or(0.0, |z| z - depth[i]);
    let after = [to(right), to(depth.get(i + width))];
    let sign = |d: f64| f64::from(u8::from(d > 0.0)) - f64::from(u8::from(d < 0.0));
    let slope = after.into_iter().chain([to(left), to(above)]).map(|d| -sign(d)).sum();
    (after[0].abs() + after[1].abs(), slope)
}
