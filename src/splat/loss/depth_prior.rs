//! Agreement with a depth prior (IndoorSplat, equation 13): the expected depths `D` of a view are correlated with those of the
//! prior, and those of planes.
//!
//! Over the `n` pixels with an opacity above one half and a value `y` of the prior, the first part is `1 - r` with Pearson's
//! correlation `r = S_xy / sqrt(S_xx S_yy)` of `x = D` and `y`, `S` being the sums of products of deviations from the means; so
//! scale and shift of the prior are free. Of a disparity, `x` is `1 / D`. The derivative of the part by `x` is
//! `-(y' - x' S_xy / S_xx) / sqrt(S_xx S_yy)`, with deviations `x'` and `y'`. Where all `x` or all `y` are equal, it is zero.
//!
//! Measured depths `y` need no scale and shift: for them the first part is the mean of `|D / y - 1|`.
//!
//! The second part is the sum over these pixels of `|D (1 / D(u - 1, v) + 1 / D(u + 1, v)) - 2|`, and of the same along `v`, divided by `n`:
//! the second difference of inverse depths, relative to the inverse depth, which is zero on planes. Pixels where depths jump are left
//! out. The paper takes absolute differences of neighbouring depths instead, which are least if all depths are equal: they pull the far
//! ends of walls and floors towards the camera.
//!
//! Depths that were aligned with points of the scene are correlated, too: a part of their remaining errors is one of scale and shift.

use super::normal_consistency::OPACITY_OFFSET;
use super::term::{ByView, LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::io::Grid2;
use crate::prior::DepthKind;
use crate::simd::SimdReal;
use crate::splat::raster::{Image, Scaled, channel, disc_plane};
use rayon::prelude::*;

/// Weights and columns of the two parts.
pub const INFO: TermInfo = TermInfo {
    weights: &["depth_prior", "depth_smoothness"],
    columns: &["depth_prior", "depth_smoothness"],
    scope: TermScope::Photographs,
};
/// Pixels with a smaller opacity are not compared.
pub(super) const LEAST_OPACITY: f64 = 0.5;
/// Depths of neighbouring pixels that differ by more than this share belong to two surfaces.
const JUMP: f64 = 0.05;
/// Without a greater mean square of the deviations, as a share of the squared mean, values count as equal.
const LEAST_VARIANCE: f64 = 1e-12;
/// Channels of the render that the term depends on, sum of depths and transmittance: of ellipsoids and of discs.
const OF_ELLIPSOIDS: [usize; 2] = [channel::DEPTH, channel::TRANSMITTANCE];
const OF_DISCS: [usize; 2] = [channel::DEPTH, disc_plane::TRANSMITTANCE];

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct DepthPriorAgreement<T> {
    by_view: Image<T>,
    depths: ExpectedDepths,
    /// Channels of the render that the last evaluation depended on; none if the term was zero.
    channels: Option<&'static [usize; 2]>,
}

impl<T: SimdReal> DepthPriorAgreement<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

/// 1, 0 or -1.
fn sign(d: f64) -> f64 {
    f64::from(u8::from(d > 0.0)) - f64::from(u8::from(d < 0.0))
}

/// Sums what `of_row` returns for each row, in the order of the rows, so that sums do not depend on the number of threads.
fn sum_of_rows<const N: usize>(rows: usize, of_row: impl Fn(usize) -> [f64; N] + Sync) -> [f64; N] {
    let sums: Vec<[f64; N]> = (0..rows).into_par_iter().map(&of_row).collect();
    sums.iter().fold([0.0; N], |sum, row| std::array::from_fn(|k| sum[k] + row[k]))
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
    /// Of the pairs (x, y) of each row that `pairs` lists; none if all x or all y are equal.
    fn of<I: Iterator<Item = (f64, f64)>>(rows: usize, pairs: impl Fn(usize) -> I + Sync) -> Option<Self> {
        let [n, x, y] = sum_of_rows(rows, |row| {
            pairs(row).fold([0.0; 3], |[n, sx, sy], (x, y)| [n + 1.0, sx + x, sy + y])
        });
        let means = [x / n, y / n];
        let [s_xx, s_xy, s_yy] = sum_of_rows(rows, |row| {
            pairs(row).fold([0.0; 3], |[xx, xy, yy], (x, y)| {
                let (x, y) = (x - means[0], y - means[1]);
                [xx + x * x, xy + x * y, yy + y * y]
            })
        });
        let has_spread = |sum: f64, mean: f64| sum > LEAST_VARIANCE * n * mean * mean;
        (has_spread(s_xx, means[0]) && has_spread(s_yy, means[1])).then(|| Self {
            means,
            s_xy,
            s_xx,
            norm: (s_xx * s_yy).sqrt(),
        })
    }

    fn value(&self) -> f64 {
        self.s_xy / self.norm
    }

    fn by_x(&self, x: f64, y: f64) -> f64 {
        let (x, y) = (x - self.means[0], y - self.means[1]);
        (y - x * self.s_xy / self.s_xx) / self.norm
    }
}

/// Expected depths of a view and how they bend. Sums need f64.
#[derive(Default)]
struct ExpectedDepths {
    width: usize,
    /// Depth of each pixel that is compared; zero elsewhere.
    depth: Vec<f64>,
    /// Reciprocals of the depths; zero where these are.
    inverse: Vec<f64>,
    /// Signs of the bends at each pixel along its row and along its column; zero where there is none.
    signs: Vec<[i8; 2]>,
}

impl ExpectedDepths {
    /// Computes the depths of the pixels that are compared, and their bends; returns the number of these pixels and the sum of
    /// the absolute bends.
    fn compute<T: SimdReal>(&mut self, view: &Image<T>, channels: &[usize; 2], prior: &Grid2) -> (f64, f64) {
        let (width, height) = (view.width, view.height);
        self.width = width;
        self.depth.resize(width * height, 0.0);
        self.inverse.resize(width * height, 0.0);
        self.signs.resize(width * height, [0; 2]);
        let rows = self.depth.par_chunks_mut(width).zip(self.inverse.par_chunks_mut(width));
        let counts =
            rows.zip(prior.data.par_chunks(width)).enumerate().map(|(row, ((depth, inverse), prior))| {
                let [sums, through] = channels.map(|channel| view.row(channel, row));
                let mut count = 0;
                for (col, (depth, inverse)) in depth.iter_mut().zip(inverse).enumerate() {
                    let opacity = 1.0 - through[col].as_f64();
                    let expected = sums[col].as_f64() / (opacity + OPACITY_OFFSET);
                    let is_compared = opacity > LEAST_OPACITY && expected > 0.0 && prior[col].is_finite();
                    [*depth, *inverse] = if is_compared { [expected, expected.recip()] } else { [0.0; 2] };
                    count += usize::from(is_compared);
                }
                count
            });
        let count: usize = counts.sum();
        let Self { depth, inverse, signs, .. } = self;
        let bend = |before: usize, at: usize, after: usize| {
            bend([depth[before], depth[at], depth[after]], inverse[before] + inverse[after])
        };
        let rows = signs.par_chunks_mut(width).enumerate();
        let sums: Vec<f64> = rows
            .map(|(row, signs)| {
                let mut sum = 0.0;
                for (col, signs) in signs.iter_mut().enumerate() {
                    let i = row * width + col;
                    let along = if 0 < col && col + 1 < width { bend(i - 1, i, i + 1) } else { 0.0 };
                    let down = if 0 < row && row + 1 < height { bend(i - width, i, i + width) } else { 0.0 };
                    sum += along.abs() + down.abs();
                    *signs = [along, down].map(|bend| sign(bend) as i8);
                }
                sum
            })
            .collect();
        (count as f64, sums.iter().sum())
    }

    /// The derivative of the sum of the absolute bends by the depth of a pixel.
    fn bends_by_depth(&self, i: usize, col: usize) -> f64 {
        let Self { width, depth, inverse, signs } = self;
        let squared = inverse[i] * inverse[i];
        let of_neighbour = |k: usize, axis: usize| f64::from(signs[k][axis]) * depth[k] * squared;
        let mut sum = 0.0;
        // Signs are zero at the ends of rows and columns.
        let [along, down] = signs[i].map(f64::from);
        if along != 0.0 {
            sum += along * (inverse[i - 1] + inverse[i + 1]);
        }
        if down != 0.0 {
            sum += down * (inverse[i - width] + inverse[i + width]);
        }
        if col > 0 {
            sum -= of_neighbour(i - 1, 0);
        }
        if col + 1 < *width {
            sum -= of_neighbour(i + 1, 0);
        }
        if i >= *width {
            sum -= of_neighbour(i - width, 1);
        }
        if i + width < depth.len() {
            sum -= of_neighbour(i + width, 1);
        }
        sum
    }
}

/// `z (1 / a + 1 / b) - 2` of the depths `a`, `z`, `b` in a line and the sum `around` of the reciprocals of `a` and `b`; zero where
/// one is unknown or they jump.
fn bend([a, z, b]: [f64; 3], around: f64) -> f64 {
    let continues = |other: f64| other > 0.0 && (other - z).abs() <= JUMP * z;
    if continues(a) && continues(b) { z * around - 2.0 } else { 0.0 }
}

impl<T: SimdReal> LossTerm<T> for DepthPriorAgreement<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        self.channels = None;
        let has_weight = weights.iter().any(|weight| *weight > 0.0);
        let priors = rendered.priors.filter(|_| has_weight);
        let Some(prior) = priors.and_then(|priors| priors.depth.as_ref()) else { return 0.0 };
        let (view, kind, values) = (rendered.view, prior.kind, &prior.values);
        let channels = if rendered.discs.is_some() { &OF_DISCS } else { &OF_ELLIPSOIDS };
        let (pixels, bends) = self.depths.compute(view, channels, values);
        let (width, depths) = (view.width, &self.depths);
        let is_measured = kind == DepthKind::Measured;
        let correlation = (!is_measured).then(|| {
            Correlation::of(view.height, |row| {
                let places = row * width..(row + 1) * width;
                let known = places.filter(|i| depths.depth[*i] > 0.0);
                known.map(|i| (kind.of_depth(depths.depth[i]), f64::from(values.data[i])))
            })
        });
        let correlation = correlation.flatten();
        let per_pixel = 1.0 / pixels.max(1.0);
        let (of_agreement, of_bends) = (weights[0], weights[1] * per_pixel);
        self.by_view.resize(width, view.height, channels.len());
        let rows = self.by_view.data.par_chunks_mut(channels.len() * width).enumerate();
        let off: Vec<f64> = rows
            .map(|(row, by)| {
                by.fill(T::zero());
                let (by_sum, by_through) = by.split_at_mut(width);
                let through = view.row(channels[1], row);
                let mut sum = 0.0;
                for col in 0..width {
                    let i = row * width + col;
                    let (depth, expected) = (depths.depth[i], f64::from(values.data[i]));
                    if depth == 0.0 {
                        continue;
                    }
                    let mut by_depth = of_bends * depths.bends_by_depth(i, col);
                    if is_measured {
                        let off = depth / expected - 1.0;
                        sum += off.abs();
                        by_depth += of_agreement * per_pixel * sign(off) / expected;
                    } else if let Some(correlation) = &correlation {
                        let x = kind.of_depth(depth);
                        let x_by_depth = if kind == DepthKind::Disparity { -x * x } else { 1.0 };
                        by_depth -= of_agreement * correlation.by_x(x, expected) * x_by_depth;
                    }
                    let per_opacity = by_depth / (1.0 - through[col].as_f64() + OPACITY_OFFSET);
                    by_sum[col] = T::from_f64(per_opacity);
                    by_through[col] = T::from_f64(per_opacity * depth);
                }
                sum
            })
            .collect();
        columns[0] = match kind {
            DepthKind::Measured => per_pixel * off.iter().sum::<f64>(),
            _ => correlation.as_ref().map_or(0.0, |c| 1.0 - c.value()),
        };
        columns[1] = per_pixel * bends;
        self.channels = Some(channels);
        weights[0] * columns[0] + weights[1] * columns[1]
    }

    fn by_view(&self) -> Option<ByView<'_, T>> {
        let scaled = Scaled { image: &self.by_view, factor: T::one() };
        self.channels.map(|channels| ByView { scaled, channels })
    }
}
