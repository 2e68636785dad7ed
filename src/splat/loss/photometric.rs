//! The photometric loss of 3DGS and EOGS, `0.8 L1 + 0.2 (1 - SSIM)`, with its gradient.
//!
//! SSIM after Wang et al. 2004 with an 11 × 11 Gaussian window of σ = 1.5 px and zeros beyond the border, as in 3DGS. It is
//! written by hand because no library computes the gradient, and because the separable blurs are fused with the L1 loss:
//! together they are a large part of an iteration.
//!
//! With `x` the picture and `y` the target, SSIM is a function of four blurred images: `x`, `y`, `xx + yy` and `xy`, the
//! *moments*. Its gradient by `x` is the blur of its derivatives by the moments, as the window is symmetric.

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, Scaled};
use rayon::prelude::*;

/// The term has weight 1; its columns are the mean absolute difference of linear colours and the mean SSIM.
pub const INFO: TermInfo = TermInfo { weights: &[], columns: &["l1", "ssim"], scope: TermScope::Any };
/// Number of taps of the window along one axis.
const TAPS: usize = 11;
/// Standard deviation of the window, pixels.
const SIGMA: f64 = 1.5;
/// The constants of SSIM for values in [0, 1]: 0.01² and 0.03².
pub const SSIM_C1: f64 = 1e-4;
/// See [`SSIM_C1`].
pub const SSIM_C2: f64 = 9e-4;
/// Weight λ of SSIM against L1 (3DGS, equation 7).
pub const SSIM_WEIGHT: f64 = 0.2;

/// Number of taps on either side of the middle one.
pub const RADIUS: usize = TAPS / 2;
/// Number of rows of a strip, which one task processes.
const STRIP_ROWS: usize = 16;
/// Number of adjacent rows that are blurred along the columns together, as their windows share most rows.
const ROW_PAIR: usize = 2;
/// Number of rows that the windows of a pair cover together.
const COVERED_ROWS: usize = TAPS + ROW_PAIR - 1;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct Photometric<T> {
    /// Derivatives of the loss by the blurred `x`, `xx + yy` and `xy` of each colour channel: nine channels.
    by_moments: Image<T>,
    by_picture: Image<T>,
    /// Picture and target times visibility.
    visible: [Image<T>; 2],
    strips: Vec<Strip<T>>,
}

/// Buffers of a strip.
#[derive(Default)]
struct Strip<T> {
    /// Pairs of rows blurred along the columns, with zeros on either side.
    columns: [[Vec<T>; 4]; ROW_PAIR],
    zeros: Vec<T>,
    sum: f64,
}

/// Mean absolute difference and mean SSIM of two images.
#[derive(Clone, Copy, Debug, Default)]
pub struct Similarity {
    /// Mean absolute difference over pixels and channels.
    pub l1: f64,
    /// Mean SSIM over pixels and channels.
    pub ssim: f64,
}

impl Similarity {
    /// `0.8 L1 + 0.2 (1 - SSIM)`.
    #[must_use]
    pub fn loss(&self) -> f64 {
        (1.0 - SSIM_WEIGHT) * self.l1 + SSIM_WEIGHT * (1.0 - self.ssim)
    }
}

/// The first half of the window's taps and the middle one; the window is symmetric.
#[must_use]
pub fn window<T: Real>() -> [T; RADIUS + 1] {
    let g = |i: usize| (-((i as f64 - RADIUS as f64) / SIGMA).powi(2) / 2.0).exp();
    let sum: f64 = (0..TAPS).map(g).sum();
    std::array::from_fn(|i| T::from_f64(g(i) / sum))
}

/// Blurs a vector of pixels along a row that has zeros on either side, from column `start` on.
#[inline(always)]
fn blur_along<S: Simd>(
    simd: S,
    window: &[SimdVec<S>; RADIUS + 1],
    row: &[S::Scalar],
    start: usize,
) -> SimdVec<S> {
    // Rows have at least sixteen zeros on either side, so that one check of the bounds suffices for all taps.
    let Some(near) = row[start..].first_chunk::<{ 3 * MAX_LANES }>() else { return window[0] };
    let first = MAX_LANES - RADIUS;
    let mut sum = window[RADIUS] * SimdVec::load_from(simd, near, first + RADIUS);
    for t in 0..RADIUS {
        let pair =
            SimdVec::load_from(simd, near, first + t) + SimdVec::load_from(simd, near, first + TAPS - 1 - t);
        sum = window[t].mul_add(pair, sum);
    }
    sum
}

/// The weights with which each row of a pair takes the rows that the pair's windows cover.
#[inline(always)]
fn pair_weights<S: Simd>(simd: S) -> [[SimdVec<S>; COVERED_ROWS]; ROW_PAIR] {
    let window = window();
    let mut out = [[SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); COVERED_ROWS]; ROW_PAIR];
    for j in 0..ROW_PAIR {
        for t in 0..TAPS {
            out[j][j + t] = SimdVec::broadcast(simd, window[RADIUS - RADIUS.abs_diff(t)]);
        }
    }
    out
}

/// The rows of a channel that the windows around `row` and the next row cover; `zeros` beyond the border.
#[inline(always)]
fn covered_rows<'a, T: Real>(
    image: &'a Image<T>,
    channel: usize,
    row: usize,
    zeros: &'a [T],
) -> [&'a [T]; COVERED_ROWS] {
    std::array::from_fn(|t| match (row + t).checked_sub(RADIUS) {
        Some(r) if r < image.height => image.row(channel, r),
        _ => &zeros[..image.width],
    })
}

/// Blurs `x`, `y`, `xx + yy` and `xy` along the columns, for a pair of rows, from the rows that its windows cover.
#[inline(always)]
fn blur_moments_down<S: Simd>(
    simd: S,
    down: &[[SimdVec<S>; COVERED_ROWS]; ROW_PAIR],
    xs: &[&[S::Scalar]; COVERED_ROWS],
    ys: &[&[S::Scalar]; COVERED_ROWS],
    start: usize,
) -> [[SimdVec<S>; 4]; ROW_PAIR] {
    let mut sums = [[SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); 4]; ROW_PAIR];
    for t in 0..COVERED_ROWS {
        let (x, y) = (SimdVec::load_from(simd, xs[t], start), SimdVec::load_from(simd, ys[t], start));
        let (squares, xy) = (x.mul_add(x, y * y), x * y);
        for j in 0..ROW_PAIR {
            let w = down[j][t];
            sums[j][0] = w.mul_add(x, sums[j][0]);
            sums[j][1] = w.mul_add(y, sums[j][1]);
            sums[j][2] = w.mul_add(squares, sums[j][2]);
            sums[j][3] = w.mul_add(xy, sums[j][3]);
        }
    }
    sums
}

/// Blurs a pair of rows along the columns.
#[inline(always)]
fn blur_down<S: Simd>(
    simd: S,
    down: &[[SimdVec<S>; COVERED_ROWS]; ROW_PAIR],
    rows: &[&[S::Scalar]; COVERED_ROWS],
    start: usize,
) -> [SimdVec<S>; ROW_PAIR] {
    let mut sums = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); ROW_PAIR];
    for t in 0..COVERED_ROWS {
        let row = SimdVec::load_from(simd, rows[t], start);
        for j in 0..ROW_PAIR {
            sums[j] = down[j][t].mul_add(row, sums[j]);
        }
    }
    sums
}

impl<T: SimdReal> LossTerm<T> for Photometric<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, _: &[f64], columns: &mut [f64]) -> f64 {
        let similarity = match rendered.visibility {
            None => self.compare(rendered.picture, rendered.target).0,
            Some(visibility) => self.compare_visible(rendered.picture, rendered.target, visibility),
        };
        columns.copy_from_slice(&[similarity.l1, similarity.ssim]);
        similarity.loss()
    }

    fn by_picture(&self) -> Option<Scaled<'_, T>> {
        Some(Scaled { image: &self.by_picture, factor: T::one() })
    }
}

impl<T: SimdReal> Photometric<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }

    /// Compares `picture` with `target`, both multiplied by the visibility of each pixel (SatGS, equation 15).
    fn compare_visible(
        &mut self,
        picture: &Image<T>,
        target: &Image<T>,
        visibility: &Image<T>,
    ) -> Similarity {
        let [mut seen_picture, mut seen_target] = std::mem::take(&mut self.visible);
        multiply(picture, visibility, &mut seen_picture);
        multiply(target, visibility, &mut seen_target);
        let (similarity, _) = self.compare(&seen_picture, &seen_target);
        self.visible = [seen_picture, seen_target];
        let width = visibility.width;
        let rows = self.by_picture.data.par_chunks_mut(width).enumerate();
        rows.for_each(|(line, by)| {
            by.iter_mut().zip(visibility.row(0, line / 3)).for_each(|(by, v)| *by = *by * *v);
        });
        similarity
    }

    /// Compares `picture` with `target`, three channels each. Returns the similarity, and the derivatives of
    /// [`Similarity::loss`] with respect to the picture. Masked pixels must be equal in both.
    pub fn compare(&mut self, picture: &Image<T>, target: &Image<T>) -> (Similarity, &Image<T>) {
        let (width, height) = (picture.width, picture.height);
        let count = (3 * width * height) as f64;
        self.strips.resize_with(height.div_ceil(STRIP_ROWS), Strip::default);
        for strip in &mut self.strips {
            for row in strip.columns.iter_mut().flatten().chain([&mut strip.zeros]) {
                row.clear();
                row.resize(width.next_multiple_of(MAX_LANES) + 3 * MAX_LANES, T::zero());
            }
        }

        self.by_moments.resize(width, height, 9);
        let strips = self.by_moments.data.par_chunks_mut(STRIP_ROWS * 9 * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (by_moments, strip))| {
            let scale = T::from_f64(-SSIM_WEIGHT / count);
            T::dispatch(SsimForward { picture, target, first_row: k * STRIP_ROWS, scale, by_moments, strip });
        });
        let ssim = self.strips.iter().map(|s| s.sum).sum::<f64>() / count;

        let by_moments = &self.by_moments;
        self.by_picture.resize(width, height, 3);
        let strips = self.by_picture.data.par_chunks_mut(STRIP_ROWS * 3 * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (by_picture, strip))| {
            let scale = T::from_f64((1.0 - SSIM_WEIGHT) / count);
            T::dispatch(SsimBackward {
                picture,
                target,
                by_moments,
                first_row: k * STRIP_ROWS,
                scale,
                by_picture,
                strip,
            });
        });
        let l1 = self.strips.iter().map(|s| s.sum).sum::<f64>() / count;
        (Similarity { l1, ssim }, &self.by_picture)
    }
}

/// Multiplies the three channels of an image by the single one of another.
fn multiply<T: Real>(image: &Image<T>, by: &Image<T>, out: &mut Image<T>) {
    out.resize(image.width, image.height, 3);
    let rows = out.data.par_chunks_mut(image.width).zip(image.data.par_chunks(image.width)).enumerate();
    rows.for_each(|(line, (out, values))| {
        let factors = by.row(0, line / 3);
        out.iter_mut().zip(values).zip(factors).for_each(|((out, v), f)| *out = *v * *f);
    });
}

/// The sum of SSIM over a strip, and `scale` times its derivatives by the blurred `x`, `xx + yy` and `xy`.
struct SsimForward<'a, T> {
    picture: &'a Image<T>,
    target: &'a Image<T>,
    first_row: usize,
    scale: T,
    by_moments: &'a mut [T],
    strip: &'a mut Strip<T>,
}

impl<T: SimdReal> SimdKernel<T> for SsimForward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { picture, target, first_row, scale, by_moments, strip } = self;
        let width = picture.width;
        let (window, down) = (broadcast_each(simd, window()), pair_weights(simd));
        let [zero, one, two, c1, c2, scale] = broadcast_each(
            simd,
            [T::zero(), T::one(), T::from_f64(2.0), T::from_f64(SSIM_C1), T::from_f64(SSIM_C2), scale],
        );
        strip.sum = 0.0;
        for (k, by_moments) in by_moments.chunks_mut(ROW_PAIR * 9 * width).enumerate() {
            for c in 0..3 {
                let row = first_row + ROW_PAIR * k;
                let (xs, ys) =
                    (covered_rows(picture, c, row, &strip.zeros), covered_rows(target, c, row, &strip.zeros));
                for start in (0..width).step_by(S::WIDTH) {
                    let blurred = blur_moments_down(simd, &down, &xs, &ys, start);
                    for j in 0..ROW_PAIR {
                        for n in 0..4 {
                            blurred[j][n].store_to(&mut strip.columns[j][n], MAX_LANES + start);
                        }
                    }
                }
                for (by_moments, columns) in by_moments.chunks_mut(9 * width).zip(&strip.columns) {
                    let (by_x, rest) = by_moments[3 * c * width..][..3 * width].split_at_mut(width);
                    let (by_xx, by_xy) = rest.split_at_mut(width);
                    let mut sum = zero;
                    for start in (0..width).step_by(S::WIDTH) {
                        let mut blurred = [zero; 4];
                        for n in 0..4 {
                            blurred[n] = blur_along(simd, &window, &columns[n], start);
                        }
                        let [ux, uy, squares, xy] = blurred;
                        let means = ux * ux + uy * uy;
                        let a1 = two * ux * uy + c1;
                        let a2 = two * (xy - ux * uy) + c2;
                        let b1 = means + c1;
                        let b2 = squares - means + c2;
                        let inverse = one / (b1 * b2);
                        let value = a1 * a2 * inverse;
                        sum += value.select_or_zero(SimdMask::first(simd, width - start));
                        let by_mean = uy * (a2 - a1) - ux * value * (b2 - b1);
                        (scale * two * by_mean * inverse).store_to(by_x, start);
                        (zero - scale * value * b1 * inverse).store_to(by_xx, start);
                        (scale * two * a1 * inverse).store_to(by_xy, start);
                    }
                    strip.sum += sum.sum().as_f64();
                }
            }
        }
    }
}

/// The derivatives of the loss by a strip of the picture, and the strip's sum of absolute differences.
struct SsimBackward<'a, T> {
    picture: &'a Image<T>,
    target: &'a Image<T>,
    by_moments: &'a Image<T>,
    first_row: usize,
    /// Weight of one absolute difference in the loss.
    scale: T,
    by_picture: &'a mut [T],
    strip: &'a mut Strip<T>,
}

impl<T: SimdReal> SimdKernel<T> for SsimBackward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { picture, target, by_moments, first_row, scale, by_picture, strip } = self;
        let width = picture.width;
        let (window, down) = (broadcast_each(simd, window()), pair_weights(simd));
        let [zero, two, scale] = broadcast_each(simd, [T::zero(), T::from_f64(2.0), scale]);
        strip.sum = 0.0;
        for (k, by_picture) in by_picture.chunks_mut(ROW_PAIR * 3 * width).enumerate() {
            for c in 0..3 {
                let row = first_row + ROW_PAIR * k;
                for n in 0..3 {
                    let by = covered_rows(by_moments, 3 * c + n, row, &strip.zeros);
                    for start in (0..width).step_by(S::WIDTH) {
                        let blurred = blur_down(simd, &down, &by, start);
                        for j in 0..ROW_PAIR {
                            blurred[j].store_to(&mut strip.columns[j][n], MAX_LANES + start);
                        }
                    }
                }
                for (j, by_picture) in by_picture.chunks_mut(3 * width).enumerate() {
                    let by_picture = &mut by_picture[c * width..][..width];
                    let (x, y) = (picture.row(c, row + j), target.row(c, row + j));
                    let mut sum = zero;
                    for start in (0..width).step_by(S::WIDTH) {
                        let mut by = [zero; 3];
                        for n in 0..3 {
                            by[n] = blur_along(simd, &window, &strip.columns[j][n], start);
                        }
                        let (x, y) = (SimdVec::load_from(simd, x, start), SimdVec::load_from(simd, y, start));
                        let d = x - y;
                        sum += d.abs();
                        (by[0] + two * x * by[1] + y * by[2] + scale * d.sign()).store_to(by_picture, start);
                    }
                    strip.sum += sum.sum().as_f64();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    fn pictures(width: usize, height: usize) -> (Image<f64>, Image<f64>) {
        let mut draw = CounterRng::new(3, 0, 0, 0);
        let mut make = || {
            let mut l = Image::zeros(width, height, 3);
            l.data.iter_mut().for_each(|v| *v = draw.uniform());
            l
        };
        (make(), make())
    }

    #[test]
    fn equal_pictures_have_no_loss_and_no_gradient() {
        let (x, _) = pictures(20, 13);
        let mut p = Photometric::default();
        let (s, g) = p.compare(&x, &x.clone());
        assert!(s.loss().abs() < 1e-12);
        assert!(g.data.iter().all(|v| v.abs() < 1e-12));
    }

    #[test]
    fn a_comparison_does_not_depend_on_earlier_ones_with_the_same_buffers() {
        let mut used = Photometric::default();
        // The first images are larger, with another number of vectors and strips.
        let (x, y) = pictures(61, 70);
        used.compare(&x, &y);
        let (x, y) = pictures(37, 29);
        let mut fresh = Photometric::default();
        let (s, t) = (used.compare(&x, &y).0, fresh.compare(&x, &y).0);
        assert_eq!((s.l1, s.ssim), (t.l1, t.ssim));
        assert_eq!(used.by_picture, fresh.by_picture);
    }

    #[test]
    fn gradient_agrees_with_central_differences() {
        let (x, y) = pictures(17, 14);
        let gradient = Photometric::default().compare(&x, &y).1.clone();
        for k in (0..x.data.len()).step_by(7) {
            let e = 1e-6;
            let at = |d: f64| {
                let mut moved = x.clone();
                moved.data[k] += d;
                Photometric::default().compare(&moved, &y).0.loss()
            };
            let numeric = (at(e) - at(-e)) / (2.0 * e);
            assert!((numeric - gradient.data[k]).abs() < 1e-9, "{k}: {numeric} {}", gradient.data[k]);
        }
    }
}
