//! Agreement with a depth prior (IndoorSplat, equation 13): the expected depths `D` of a view are correlated with those of the
//! prior, and those of planes.
//!
//! Over the `n` pixels with an opacity above one half and a value `y` of the prior, the first part is `1 - r` with Pearson's
//! correlation `r = S_xy / sqrt(S_xx S_yy)` of `x = D` and `y`, `S` being the sums of products of deviations from the means; so
//! scale and shift of the prior are free. Of a disparity, `x` is `1 / D`. The derivative of the part by `x` is
//! `-(y' - x' S_xy / S_xx) / sqrt(S_xx S_yy)`, with deviations `x'` and `y'`. Where all `x` or all `y` are equal, it is zero.
//!
//! Measured depths `y` need no scale and shift: of them the first part is the mean of `|D / y - 1|`.
//!
//! The second part is the sum over these pixels of `|D (1 / D(u - 1, v) + 1 / D(u + 1, v)) - 2|`, and of the same along `v`, divided by `n`:
//! twice the distance of a depth from the plane through its neighbours, as a share of the depth, for inverse depths are linear on planes.
//! Places where depths jump are left out. The paper has the absolute differences of neighbouring depths instead, which are least if
//! all depths are equal: they pull the far ends of walls and floors towards the camera.
//!
//! Depths that were aligned with points of the scene are correlated too: what is left of their errors is in part one of scale and shift.

use super::normal_consistency::OPACITY_OFFSET;
use super::term::{LossTerm, Rendered, Scaled, TermInfo};
use super::terms::TermInputs;
use crate::io::Grid2;
use crate::prior::DepthKind;
use crate::simd::SimdReal;
use crate::splat::raster::{Image, channel, disc_plane};
use rayon::prelude::*;

/// Weights and columns of the two parts.
pub const INFO: TermInfo =
    TermInfo { weights: &["depth_prior", "depth_smoothness"], columns: &["depth_prior", "depth_smoothness"] };
/// Pixels with a smaller opacity are not compared.
pub(super) const LEAST_OPACITY: f64 = 0.5;
/// Depths of neighbouring pixels that differ by more than this share belong to two surfaces.
const JUMP: f64 = 0.05;
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

/// 1, 0 or -1.
fn sign(d: f64) -> f64 {
    f64::from(u8::from(d > 0.0)) - f64::from(u8::from(d < 0.0))
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
        let correlate = || {
            Correlation::of(view.height, |row| {
                let places = row * width..(row + 1) * width;
                let known = places.filter(|i| depth[*i] > 0.0);
                known.map(|i| (kind.of_depth(depth[i]), f64::from(values.data[i])))
            })
        };
        let correlation = if kind == DepthKind::Measured { None } else { correlate() };
        let per_pixel = 1.0 / pixels.max(1) as f64;
        let off = |i: usize| depth[i] / f64::from(values.data[i]) - 1.0;
        let by_agreement = |i: usize| {
            if kind == DepthKind::Measured {
                return weights[0] * per_pixel * sign(off(i)) / f64::from(values.data[i]);
            }
            let inner = if kind == DepthKind::Disparity { -depth[i].powi(-2) } else { 1.0 };
            let by_x = |c: &Correlation| c.by_x(kind.of_depth(depth[i]), values.data[i].into());
            correlation.as_ref().map_or(0.0, |c| -weights[0] * by_x(c) * inner)
        };
        let planes = view.channels;
        self.by_view.resize(width, view.height, planes);
        let rows = self.by_view.data.par_chunks_mut(planes * width).enumerate();
        let sums: Vec<[f64; 2]> = rows
            .map(|(row, by)| {
                by.fill(T::zero());
                let through = view.row(disc_plane::TRANSMITTANCE, row);
                let mut sums = [0.0; 2];
                for col in (0..width).filter(|col| depth[row * width + col] > 0.0) {
                    let i = row * width + col;
                    let (bend, slope) = bends(depth, width, col, i);
                    sums[0] += bend;
                    sums[1] += off(i).abs();
                    let by_depth = by_agreement(i) + weights[1] * per_pixel * slope;
                    let per_opacity = by_depth / (1.0 - through[col].as_f64() + OPACITY_OFFSET);
                    by[channel::DEPTH * width + col] = T::from_f64(per_opacity);
                    by[disc_plane::TRANSMITTANCE * width + col] = T::from_f64(per_opacity * depth[i]);
                }
                sums
            })
            .collect();
        let sum = |k: usize| sums.iter().map(|sums: &[f64; 2]| sums[k]).sum::<f64>();
        columns[0] = match kind {
            DepthKind::Measured => per_pixel * sum(1),
            _ => correlation.as_ref().map_or(0.0, |c| 1.0 - c.value()),
        };
        columns[1] = per_pixel * sum(0);
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

/// Sum of the absolute bends at the pixel `i` of a row's column `col`, and the derivative by its depth of these and of those at its
/// neighbours.
fn bends(depth: &[f64], width: usize, col: usize, i: usize) -> (f64, f64) {
    let known = |depth: Option<&f64>| depth.copied().filter(|z| *z > 0.0);
    let across = |k: isize| {
        let is_in_row = col.checked_add_signed(k).is_some_and(|c| c < width);
        known(is_in_row.then(|| i.checked_add_signed(k)).flatten().and_then(|j| depth.get(j)))
    };
    let down = |k: isize| known(i.checked_add_signed(k * width as isize).and_then(|j| depth.get(j)));
    let along = [[-2, -1, 1, 2].map(across), [-2, -1, 1, 2].map(down)];
    along
        .into_iter()
        .map(|line| bends_of_line(depth[i], line))
        .fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1))
}

/// As [`bends`], of one line: the pixel's depth and those of the two before it and the two after it.
fn bends_of_line(z: f64, [before2, before, after, after2]: [Option<f64>; 4]) -> (f64, f64) {
    let (mut value, mut slope) = (0.0, 0.0);
    if let Some((own, around)) = before.zip(after).and_then(|(a, b)| bend(a, z, b)) {
        value = own.abs();
        slope += sign(own) * around;
    }
    for (beyond, middle) in [(before2, before), (after2, after)] {
        if let (Some(beyond), Some(middle)) = (beyond, middle)
            && let Some((of_neighbour, _)) = bend(beyond, middle, z)
        {
            slope -= sign(of_neighbour) * middle / (z * z);
        }
    }
    (value, slope)
}

/// `z (1 / a + 1 / b) - 2` of three depths in a line and its derivative by the middle one; none where they jump.
fn bend(a: f64, z: f64, b: f64) -> Option<(f64, f64)> {
    let jumps = |other: f64| (other / z - 1.0).abs() > JUMP;
    let around = a.recip() + b.recip();
    (!jumps(a) && !jumps(b)).then_some((z * around - 2.0, around))
}
