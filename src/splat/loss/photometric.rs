//! L1 and structural similarity with their gradient, fused and separable.
//!
//! SSIM after Wang et al. 2004 with an 11 × 11 Gaussian window of σ 1.5, zeros beyond the border, as 3DGS uses it.

use super::surface_prior::Prior;
use super::{LossTerm, Rendered, Scaled, TermInfo};
use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::Image;
use rayon::prelude::*;
use std::sync::Arc;

/// It always counts in full; columns are the mean absolute difference and the mean SSIM.
pub const INFO: TermInfo = TermInfo { weights: &[], columns: &["l1", "ssim"] };
/// Taps of the window.
const TAPS: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// Weight of SSIM against L1 (3DGS, EOGS).
pub const SSIM_WEIGHT: f64 = 0.2;

/// Taps on either side of the middle.
const REACH: usize = TAPS / 2;
/// Rows that are worked on together.
const ROWS: usize = 16;
/// Rows that are blurred down the columns at once: most of what one reads the next needs, too.
const PAIR: usize = 2;
/// Rows that the windows of a pair cover.
const COVERED: usize = TAPS + PAIR - 1;

/// Compares a picture with the truth; keeps its buffers.
#[derive(Default)]
pub struct Photometric<T> {
    /// Derivatives of the loss by the blurred x, xx + yy and xy of each color.
    slopes: Image<T>,
    by_picture: Image<T>,
    strips: Vec<Strip<T>>,
}

/// What a strip of rows needs besides.
#[derive(Default)]
struct Strip<T> {
    /// A pair of rows blurred down the columns, with zeros on either side.
    columns: [[Vec<T>; 4]; PAIR],
    zeros: Vec<T>,
    sum: f64,
}

/// Mean absolute difference and mean SSIM.
#[derive(Clone, Copy, Debug, Default)]
pub struct Similarity {
    /// Mean absolute difference.
    pub l1: f64,
    /// Mean structural similarity.
    pub ssim: f64,
}

impl Similarity {
    /// `0.8 L1 + 0.2 (1 - SSIM)`.
    #[must_use]
    pub fn loss(&self) -> f64 {
        (1.0 - SSIM_WEIGHT) * self.l1 + SSIM_WEIGHT * (1.0 - self.ssim)
    }
}

/// The window's first half and middle; it is symmetric.
fn window<T: Real>() -> [T; REACH + 1] {
    let g = |i: usize| (-((i as f64 - REACH as f64) / SIGMA).powi(2) / 2.0).exp();
    let sum: f64 = (0..TAPS).map(g).sum();
    std::array::from_fn(|i| T::from_f64(g(i) / sum))
}

/// Blurs along a row that has zeros on either side; from column `start` on.
#[inline(always)]
fn blur_along<S: Simd>(
    simd: S,
    window: &[SimdVec<S>; REACH + 1],
    row: &[S::Scalar],
    start: usize,
) -> SimdVec<S> {
    // Rows have sixteen zeros and more on either side: one check of the bounds is enough for all taps.
    let Some(near) = row[start..].first_chunk::<{ 3 * MAX_LANES }>() else { return window[0] };
    let first = MAX_LANES - REACH;
    let mut sum = window[REACH] * SimdVec::load_from(simd, near, first + REACH);
    for t in 0..REACH {
        let pair =
            SimdVec::load_from(simd, near, first + t) + SimdVec::load_from(simd, near, first + TAPS - 1 - t);
        sum = window[t].mul_add(pair, sum);
    }
    sum
}

/// The weights with which a pair of rows takes what it covers.
#[inline(always)]
fn windows_of_pair<S: Simd>(simd: S) -> [[SimdVec<S>; COVERED]; PAIR] {
    let window = window();
    let mut out = [[SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); COVERED]; PAIR];
    for j in 0..PAIR {
        for t in 0..TAPS {
            out[j][j + t] = SimdVec::broadcast(simd, window[REACH - REACH.abs_diff(t)]);
        }
    }
    out
}

/// The rows of a channel that the windows around `row` and the next one cover; `zeros` beyond the border.
#[inline(always)]
fn covered<'a, T: Real>(
    image: &'a Image<T>,
    channel: usize,
    row: usize,
    zeros: &'a [T],
) -> [&'a [T]; COVERED] {
    std::array::from_fn(|t| match (row + t).checked_sub(REACH) {
        Some(r) if r < image.height => image.row(channel, r),
        _ => &zeros[..image.width],
    })
}

/// A pair of rows of x, y, xx + yy and xy, blurred down the columns, from the rows that it covers.
#[inline(always)]
fn blur_moments_down<S: Simd>(
    simd: S,
    down: &[[SimdVec<S>; COVERED]; PAIR],
    xs: &[&[S::Scalar]; COVERED],
    ys: &[&[S::Scalar]; COVERED],
    start: usize,
) -> [[SimdVec<S>; 4]; PAIR] {
    let mut sums = [[SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); 4]; PAIR];
    for t in 0..COVERED {
        let (x, y) = (SimdVec::load_from(simd, xs[t], start), SimdVec::load_from(simd, ys[t], start));
        let (squares, xy) = (x.mul_add(x, y * y), x * y);
        for j in 0..PAIR {
            let w = down[j][t];
            sums[j][0] = w.mul_add(x, sums[j][0]);
            sums[j][1] = w.mul_add(y, sums[j][1]);
            sums[j][2] = w.mul_add(squares, sums[j][2]);
            sums[j][3] = w.mul_add(xy, sums[j][3]);
        }
    }
    sums
}

/// A pair of rows blurred down the columns.
#[inline(always)]
fn blur_down<S: Simd>(
    simd: S,
    down: &[[SimdVec<S>; COVERED]; PAIR],
    rows: &[&[S::Scalar]; COVERED],
    start: usize,
) -> [SimdVec<S>; PAIR] {
    let mut sums = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); PAIR];
    for t in 0..COVERED {
        let row = SimdVec::load_from(simd, rows[t], start);
        for j in 0..PAIR {
            sums[j] = down[j][t].mul_add(row, sums[j]);
        }
    }
    sums
}

impl<T: SimdReal> LossTerm<T> for Photometric<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, _: &[f64], columns: &mut [f64]) -> f64 {
        let (similarity, _) = self.compare(rendered.picture, rendered.target);
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
    pub fn new(_: Option<&Arc<Prior>>) -> Self {
        Self::default()
    }

    /// Compares `picture` with `truth` (three channels each); pixels equal in both contribute nothing.
    ///
    /// Returns the figures and the loss's derivatives by the picture.
    pub fn compare(&mut self, picture: &Image<T>, truth: &Image<T>) -> (Similarity, &Image<T>) {
        let (width, height) = (picture.width, picture.height);
        let count = (3 * width * height) as f64;
        self.strips.resize_with(height.div_ceil(ROWS), Strip::default);
        for strip in &mut self.strips {
            for row in strip.columns.iter_mut().flatten().chain([&mut strip.zeros]) {
                row.clear();
                row.resize(width.next_multiple_of(MAX_LANES) + 3 * MAX_LANES, T::zero());
            }
        }

        self.slopes.resize(width, height, 9);
        let strips = self.slopes.data.par_chunks_mut(ROWS * 9 * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (slopes, strip))| {
            let scale = T::from_f64(-SSIM_WEIGHT / count);
            T::dispatch(Structure { picture, truth, first_row: k * ROWS, scale, slopes, strip });
        });
        let ssim = self.strips.iter().map(|s| s.sum).sum::<f64>() / count;

        let slopes = &self.slopes;
        self.by_picture.resize(width, height, 3);
        let strips = self.by_picture.data.par_chunks_mut(ROWS * 3 * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (by_picture, strip))| {
            let scale = T::from_f64((1.0 - SSIM_WEIGHT) / count);
            T::dispatch(Slope { picture, truth, slopes, first_row: k * ROWS, scale, by_picture, strip });
        });
        let l1 = self.strips.iter().map(|s| s.sum).sum::<f64>() / count;
        (Similarity { l1, ssim }, &self.by_picture)
    }
}

/// SSIM of a strip, and `scale` times its derivatives by the blurred x, xx + yy and xy.
struct Structure<'a, T> {
    picture: &'a Image<T>,
    truth: &'a Image<T>,
    first_row: usize,
    scale: T,
    slopes: &'a mut [T],
    strip: &'a mut Strip<T>,
}

impl<T: SimdReal> SimdKernel<T> for Structure<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { picture, truth, first_row, scale, slopes, strip } = self;
        let width = picture.width;
        let (window, down) = (broadcast_each(simd, window()), windows_of_pair(simd));
        let [zero, one, two, c1, c2, scale] = broadcast_each(
            simd,
            [T::zero(), T::one(), T::from_f64(2.0), T::from_f64(C1), T::from_f64(C2), scale],
        );
        strip.sum = 0.0;
        for (k, slopes) in slopes.chunks_mut(PAIR * 9 * width).enumerate() {
            for c in 0..3 {
                let row = first_row + PAIR * k;
                let (xs, ys) = (covered(picture, c, row, &strip.zeros), covered(truth, c, row, &strip.zeros));
                for start in (0..width).step_by(S::WIDTH) {
                    let blurred = blur_moments_down(simd, &down, &xs, &ys, start);
                    for j in 0..PAIR {
                        for n in 0..4 {
                            blurred[j][n].store_to(&mut strip.columns[j][n], MAX_LANES + start);
                        }
                    }
                }
                for (slopes, columns) in slopes.chunks_mut(9 * width).zip(&strip.columns) {
                    let (by_x, rest) = slopes[3 * c * width..][..3 * width].split_at_mut(width);
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

/// The loss's derivatives by a strip of the picture, and its sum of absolute differences.
struct Slope<'a, T> {
    picture: &'a Image<T>,
    truth: &'a Image<T>,
    slopes: &'a Image<T>,
    first_row: usize,
    /// Weight of one absolute difference.
    scale: T,
    by_picture: &'a mut [T],
    strip: &'a mut Strip<T>,
}

impl<T: SimdReal> SimdKernel<T> for Slope<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { picture, truth, slopes, first_row, scale, by_picture, strip } = self;
        let width = picture.width;
        let (window, down) = (broadcast_each(simd, window()), windows_of_pair(simd));
        let [zero, two, scale] = broadcast_each(simd, [T::zero(), T::from_f64(2.0), scale]);
        strip.sum = 0.0;
        for (k, by_picture) in by_picture.chunks_mut(PAIR * 3 * width).enumerate() {
            for c in 0..3 {
                let row = first_row + PAIR * k;
                for n in 0..3 {
                    let by = covered(slopes, 3 * c + n, row, &strip.zeros);
                    for start in (0..width).step_by(S::WIDTH) {
                        let blurred = blur_down(simd, &down, &by, start);
                        for j in 0..PAIR {
                            blurred[j].store_to(&mut strip.columns[j][n], MAX_LANES + start);
                        }
                    }
                }
                for (j, by_picture) in by_picture.chunks_mut(3 * width).enumerate() {
                    let by_picture = &mut by_picture[c * width..][..width];
                    let (x, y) = (picture.row(c, row + j), truth.row(c, row + j));
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
    fn what_was_compared_before_does_not_matter() {
        let mut used = Photometric::default();
        // Wider and higher, of another number of lanes and strips.
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
