//! L1 and structural similarity with their gradient, fused and separable.
//!
//! SSIM after Wang et al. 2004 with an 11 × 11 Gaussian window of σ 1.5, zeros beyond the border, as 3DGS uses it.

use super::lanes::{Kernel, LANES, Lanes, Lanewise, Row, splat_each};
use super::raster::Layers;
use super::real::Real;
use rayon::prelude::*;

/// Taps of the window.
const TAPS: usize = 11;
const SIGMA: f64 = 1.5;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// Weight of SSIM against L1 (3DGS, EOGS).
pub const SSIM_WEIGHT: f64 = 0.2;

/// Taps on either side of the middle.
const REACH: usize = TAPS / 2;
/// Rows of a strip, which one thread works on.
const ROWS: usize = 96;
/// Rows that are blurred down the columns together, the rows that they need, and the rows that are kept for it.
const TOGETHER: usize = 4;
const NEEDED: usize = TAPS + TOGETHER - 1;
const KEPT: usize = NEEDED.next_multiple_of(TOGETHER);

/// Compares a picture with the truth; keeps its buffers.
#[derive(Default)]
pub struct Photometric<T> {
    by_picture: Layers<T>,
    strips: Vec<Strip<T>>,
}

/// What a strip of rows needs besides. Padded rows have zeros on either side.
#[derive(Default)]
struct Strip<T> {
    /// Rows of x, y, xx + yy and xy, blurred down the columns; padded.
    columns: [[Vec<T>; TOGETHER]; 4],
    /// Derivatives of the loss by a row's blurred x, xx + yy and xy; padded.
    slopes: [Vec<T>; 3],
    /// The last rows' slopes, blurred along the row, oldest first.
    blurred: [[Vec<T>; KEPT]; 3],
    zeros: Vec<T>,
    difference: f64,
    similarity: f64,
}

impl<T: Real> Strip<T> {
    fn resize(&mut self, width: usize) {
        let wide = width.next_multiple_of(LANES);
        let padded = self.columns.as_flattened_mut().iter_mut().chain(&mut self.slopes);
        padded.for_each(|row| row.resize(wide + 2 * LANES, T::zero()));
        self.blurred.as_flattened_mut().iter_mut().for_each(|row| row.resize(wide, T::zero()));
        self.zeros.resize(wide, T::zero());
    }
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
    std::array::from_fn(|i| T::of(g(i) / sum))
}

impl<T: Lanewise> Photometric<T> {
    /// Derivatives of the last comparison's loss by the picture.
    #[must_use]
    pub fn by_picture(&self) -> &Layers<T> {
        &self.by_picture
    }

    /// Compares `picture` with `truth` (three channels each); pixels equal in both contribute nothing.
    ///
    /// Returns the figures and the loss's derivatives by the picture.
    pub fn compare(&mut self, picture: &Layers<T>, truth: &Layers<T>) -> (Similarity, &Layers<T>) {
        let (width, height) = (picture.width, picture.height);
        let count = (3 * width * height) as f64;
        self.strips.resize_with(height.div_ceil(ROWS), Strip::default);
        self.by_picture.resize(width, height, 3);
        let strips = self.by_picture.data.par_chunks_mut(ROWS * 3 * width).zip(&mut self.strips);
        strips.enumerate().for_each(|(k, (by_picture, strip))| {
            let weights = [1.0 - SSIM_WEIGHT, -SSIM_WEIGHT].map(|w| T::of(w / count));
            strip.resize(width);
            T::dispatch(Compare { picture, truth, first_row: k * ROWS, weights, by_picture, strip });
        });
        let mean = |of: fn(&Strip<T>) -> f64| self.strips.iter().map(of).sum::<f64>() / count;
        (Similarity { l1: mean(|s| s.difference), ssim: mean(|s| s.similarity) }, &self.by_picture)
    }
}

/// Compares a strip, channel by channel. Slopes stay in the core's cache: they are blurred along their row, and down
/// the columns as soon as all rows are there.
struct Compare<'a, T> {
    picture: &'a Layers<T>,
    truth: &'a Layers<T>,
    first_row: usize,
    /// Of one absolute difference and one pixel's similarity.
    weights: [T; 2],
    by_picture: &'a mut [T],
    strip: &'a mut Strip<T>,
}

impl<T: Lanewise> Kernel<T> for Compare<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { picture, truth, first_row, weights, by_picture, strip } = self;
        let (width, height) = (picture.width, picture.height as isize);
        let k = Constants::new(lanes, weights);
        let rows = first_row as isize..(first_row + by_picture.len() / (3 * width)) as isize;
        (strip.difference, strip.similarity) = (0.0, 0.0);
        for channel in 0..3 {
            // The slopes' rows run ahead of the picture's.
            let mut next = rows.start;
            for first in (rows.start - REACH as isize..).step_by(TOGETHER) {
                blur_columns(&k, [picture, truth], channel, first, strip);
                strip.blurred.iter_mut().for_each(|rows| rows.rotate_left(TOGETHER));
                for n in 0..TOGETHER {
                    let (row, place) = (first + n as isize, KEPT - TOGETHER + n);
                    if (0..height).contains(&row) {
                        let similarity = compare_row(&k, width, n, strip);
                        strip.similarity += if rows.contains(&row) { similarity } else { 0.0 };
                        blur_row(&k, width, place, strip);
                    } else {
                        strip.blurred.iter_mut().for_each(|rows| rows[place].fill(T::zero()));
                    }
                }
                if first + (TOGETHER + REACH) as isize == next + KEPT as isize {
                    let out = &mut by_picture[(next - rows.start) as usize * 3 * width..];
                    slope_rows(&k, [picture, truth], channel, next as usize, strip, out);
                    next += TOGETHER as isize;
                    if next >= rows.end {
                        break;
                    }
                }
            }
        }
    }
}

/// What a comparison computes with.
struct Constants<L: Lanes> {
    lanes: L,
    window: [Row<L>; REACH + 1],
    zero: Row<L>,
    two: Row<L>,
    c1: Row<L>,
    c2: Row<L>,
    of_difference: Row<L>,
    of_similarity: Row<L>,
    /// Each lane's number.
    lane: Row<L>,
}

impl<L: Lanes> Constants<L> {
    #[inline(always)]
    fn new(lanes: L, weights: [L::Number; 2]) -> Self {
        let splat = |v: f64| Row::splat(lanes, L::Number::of(v));
        let [of_difference, of_similarity] = splat_each(lanes, weights);
        Self {
            lanes,
            window: splat_each(lanes, window()),
            zero: splat(0.0),
            two: splat(2.0),
            c1: splat(C1),
            c2: splat(C2),
            of_difference,
            of_similarity,
            lane: Row::load(lanes, &std::array::from_fn::<_, LANES, _>(|i| L::Number::of(i as f64))),
        }
    }
}

/// Blurs down the columns.
#[inline(always)]
fn blur_down<L: Lanes>(k: &Constants<L>, rows: &[Row<L>; NEEDED]) -> [Row<L>; TOGETHER] {
    let mut sums = [k.zero; TOGETHER];
    for n in 0..TOGETHER {
        sums[n] = k.window[REACH] * rows[n + REACH];
        for t in 0..REACH {
            sums[n] = k.window[t].mul_add(rows[n + t] + rows[n + TAPS - 1 - t], sums[n]);
        }
    }
    sums
}

/// Fills the strip's columns with those of the rows from `first` on.
#[inline(always)]
fn blur_columns<L: Lanes>(
    k: &Constants<L>,
    images: [&Layers<L::Number>; 2],
    channel: usize,
    first: isize,
    strip: &mut Strip<L::Number>,
) {
    let Strip { columns, zeros, .. } = strip;
    let rows = |image| -> [&[L::Number]; NEEDED] {
        let image: &Layers<_> = image;
        std::array::from_fn(|t| match usize::try_from(first + t as isize - REACH as isize) {
            Ok(row) if row < image.height => image.row(channel, row),
            _ => &zeros[..image.width],
        })
    };
    let [xs, ys] = images.map(rows);
    for start in (0..images[0].width).step_by(L::WIDTH) {
        let mut taps = [[k.zero; NEEDED]; 4];
        for t in 0..NEEDED {
            let x = Row::load_from(k.lanes, xs[t], start);
            let y = Row::load_from(k.lanes, ys[t], start);
            (taps[0][t], taps[1][t], taps[2][t], taps[3][t]) = (x, y, x.mul_add(x, y * y), x * y);
        }
        for q in 0..4 {
            let sums = blur_down(k, &taps[q]);
            for n in 0..TOGETHER {
                sums[n].store_to(&mut columns[q][n], LANES + start);
            }
        }
    }
}

/// The sum of a row's similarities, from the strip's columns; their slopes go to the strip.
#[inline(always)]
fn compare_row<L: Lanes>(k: &Constants<L>, width: usize, n: usize, strip: &mut Strip<L::Number>) -> f64 {
    let Strip { columns, slopes: [by_x, by_xx, by_xy], .. } = strip;
    let mut sum = k.zero;
    for start in (0..width).step_by(L::WIDTH) {
        let mut blurred = [k.zero; 4];
        for q in 0..4 {
            blurred[q] = blur_along(k, &columns[q][n], start);
        }
        let [ux, uy, squares, xy] = blurred;
        let means = ux * ux + uy * uy;
        let a1 = k.two * ux * uy + k.c1;
        let a2 = k.two * (xy - ux * uy) + k.c2;
        let b1 = means + k.c1;
        let b2 = squares - means + k.c2;
        // Nothing beyond the border.
        let inside = Row::splat(k.lanes, L::Number::of((width - start) as f64 - 1.0)).at_least(k.lane);
        let inverse = (b1 * b2).reciprocal().keep(inside);
        let value = a1 * a2 * inverse;
        sum += value;
        let scale = k.of_similarity * inverse;
        let by_mean = uy * (a2 - a1) - ux * value * (b2 - b1);
        (scale * k.two * by_mean).store_to(by_x, LANES + start);
        (k.zero - scale * value * b1).store_to(by_xx, LANES + start);
        (scale * k.two * a1).store_to(by_xy, LANES + start);
    }
    sum.sum().wide()
}

/// Blurs the strip's slopes along their row, which goes to `place`.
#[inline(always)]
fn blur_row<L: Lanes>(k: &Constants<L>, width: usize, place: usize, strip: &mut Strip<L::Number>) {
    for (slopes, blurred) in strip.slopes.iter().zip(&mut strip.blurred) {
        for start in (0..width).step_by(L::WIDTH) {
            blur_along(k, slopes, start).store_to(&mut blurred[place], start);
        }
    }
}

/// Blurs a padded row, the columns from `start` on.
#[inline(always)]
fn blur_along<L: Lanes>(k: &Constants<L>, row: &[L::Number], start: usize) -> Row<L> {
    // One check of the bounds is enough for all taps.
    let near = &row[start + LANES - REACH..][..TAPS - 1 + L::WIDTH];
    let at = |tap: usize| Row::load(k.lanes, &near[tap..]);
    let mut sum = k.window[REACH] * at(REACH);
    for t in 0..REACH {
        sum = k.window[t].mul_add(at(t) + at(TAPS - 1 - t), sum);
    }
    sum
}

/// The loss's derivatives by the picture's rows from `first` on, as far as `out` has them, from the strip's slopes;
/// adds up the absolute differences.
#[inline(always)]
fn slope_rows<L: Lanes>(
    k: &Constants<L>,
    [picture, truth]: [&Layers<L::Number>; 2],
    channel: usize,
    first: usize,
    strip: &mut Strip<L::Number>,
    out: &mut [L::Number],
) {
    let width = picture.width;
    let count = TOGETHER.min(out.len() / (3 * width));
    let mut sum = k.zero;
    for start in (0..width).step_by(L::WIDTH) {
        let mut by = [[k.zero; TOGETHER]; 3];
        for q in 0..3 {
            let mut taps = [k.zero; NEEDED];
            for t in 0..NEEDED {
                taps[t] = Row::load(k.lanes, &strip.blurred[q][t][start..]);
            }
            by[q] = blur_down(k, &taps);
        }
        for n in 0..count {
            let x = Row::load_from(k.lanes, picture.row(channel, first + n), start);
            let y = Row::load_from(k.lanes, truth.row(channel, first + n), start);
            let d = x - y;
            sum += d.max(k.zero - d);
            let sign = k.of_difference.keep(d.at_least(k.zero)) - k.of_difference.keep(k.zero.at_least(d));
            let by_x = by[0][n] + k.two * x * by[1][n] + y * by[2][n] + sign;
            by_x.store_to(&mut out[(3 * n + channel) * width..][..width], start);
        }
    }
    strip.difference += sum.sum().wide();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::random::Draw;

    fn pictures(width: usize, height: usize) -> (Layers<f64>, Layers<f64>) {
        let mut draw = Draw::new(3, 0, 0, 0);
        let mut make = || {
            let mut l = Layers::zeros(width, height, 3);
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
