//! Looking up, from a view's pixels and their altitudes, another camera of the same family: the sun's image, or a
//! virtual view's. A shear carries pixel (col, row) at altitude z to `(col, row) - shear * z - origin`.

use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdMask, SimdVec, broadcast_each};
use crate::splat::raster::{Image, STRIPES};
use rayon::prelude::*;
use std::ops::Range;

/// How a view's pixels reach another image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShearWarp<T> {
    /// Pixels per metre of altitude.
    pub shear: [T; 2],
    /// Position of the other image's first pixel in the sheared view, pixels.
    pub origin: [T; 2],
}

/// Where neighbouring pixels of a view lie in another image: each between four pixels of it.
pub struct Places<S: Simd> {
    /// Which of them lie inside; the others' places say nothing.
    pub inside: SimdMask<S>,
    col: [u32; MAX_LANES],
    row: [u32; MAX_LANES],
    /// The pixel at (col, row) in the image's first channel.
    start: [usize; MAX_LANES],
    /// Distance to the pixel at (col, row), in [0, 1].
    part: [SimdVec<S>; 2],
}

/// Some rows of an image that derivatives are added to, all channels of a pixel side by side.
#[derive(Debug)]
pub struct GradientWindow<T, const C: usize> {
    width: usize,
    first_row: usize,
    data: Vec<[T; C]>,
}

impl<T, const C: usize> Default for GradientWindow<T, C> {
    fn default() -> Self {
        Self { width: 0, first_row: 0, data: Vec::new() }
    }
}

impl<T: Real> ShearWarp<T> {
    /// Where the pixels at `columns` of a row, as many as there are lanes, lie in `image`.
    #[inline(always)]
    pub fn places<S: Simd<Scalar = T>>(
        &self,
        simd: S,
        columns: Range<usize>,
        row: usize,
        altitude: SimdVec<S>,
        image: &Image<T>,
    ) -> Places<S> {
        let [shear_x, shear_y] = broadcast_each(simd, self.shear);
        let (last_col, last_row) =
            (T::from_f64(image.width as f64 - 1.0), T::from_f64(image.height as f64 - 1.0));
        let [zero, right, bottom] = broadcast_each(simd, [T::zero(), last_col, last_row]);
        let (col, row) = (T::from_f64(columns.start as f64), T::from_f64(row as f64));
        let x =
            SimdVec::broadcast(simd, col - self.origin[0]) + SimdVec::lane_indices(simd) - shear_x * altitude;
        let y = SimdVec::broadcast(simd, row - self.origin[1]) - shear_y * altitude;
        let inside = SimdMask::first(simd, columns.len())
            .and(x.greater_equal(zero))
            .and(y.greater_equal(zero))
            .and(right.greater_than(x))
            .and(bottom.greater_than(y));
        // Also where it is not a number: every place can be read.
        let (x, y) = (x.select_or_zero(inside), y.select_or_zero(inside));
        let (left, top) = (x.floor(), y.floor());
        let (mut col, mut row) = ([0; MAX_LANES], [0; MAX_LANES]);
        left.store_u32(&mut col);
        top.store_u32(&mut row);
        let mut start = [0; MAX_LANES];
        for lane in 0..S::WIDTH {
            start[lane] = row[lane] as usize * image.channels * image.width + col[lane] as usize;
        }
        Places { inside, col, row, start, part: [x - left, y - top] }
    }

    /// Rows of an image `height` high that pixels of `rows` are looked up in, of which `altitudes` are all.
    pub fn rows<'a>(
        &self,
        rows: Range<usize>,
        altitudes: impl Iterator<Item = &'a T>,
        height: usize,
    ) -> Range<usize> {
        let (low, high) =
            altitudes.fold((T::infinity(), T::neg_infinity()), |(l, h), z| (l.min(*z), h.max(*z)));
        let [a, b] = [low, high].map(|z| self.shear[1] * z + self.origin[1]);
        // A row more on either side, for rounding.
        let first = T::from_f64(rows.start as f64 - 1.0) - a.max(b);
        let end = T::from_f64(rows.end as f64 + 2.0) - a.min(b);
        let inside = |row: T| row.max(T::zero()).min(T::from_f64(height as f64)).as_u32() as usize;
        inside(first)..inside(end).max(inside(first))
    }

    /// Derivative of looked-up values by the altitude, from their slopes by column and row.
    #[inline(always)]
    pub fn by_altitude<S: Simd<Scalar = T>>(&self, simd: S, slopes: [SimdVec<S>; 2]) -> SimdVec<S> {
        let [zero, x, y] = broadcast_each(simd, [T::zero(), self.shear[0], self.shear[1]]);
        zero - x * slopes[0] - y * slopes[1]
    }
}

impl<T: Real, S: Simd<Scalar = T>> Places<S> {
    /// Bilinear values of a channel and their slopes by column and row; zero where outside.
    #[inline(always)]
    pub fn values(&self, simd: S, image: &Image<T>, channel: usize) -> (SimdVec<S>, [SimdVec<S>; 2]) {
        let zero = SimdVec::broadcast(simd, T::zero());
        if !self.inside.any() {
            return (zero, [zero; 2]);
        }
        let mut corners = [[T::zero(); MAX_LANES]; 4];
        let upper = &image.data[channel * image.width..];
        let lower = &upper[image.channels * image.width..];
        for lane in 0..S::WIDTH {
            let [a, b] = *pair(&upper[self.start[lane]..]);
            let [c, d] = *pair(&lower[self.start[lane]..]);
            (corners[0][lane], corners[1][lane]) = (a, b);
            (corners[2][lane], corners[3][lane]) = (c, d);
        }
        let mut rows = [zero; 4];
        for k in 0..4 {
            rows[k] = SimdVec::load(simd, &corners[k]);
        }
        let ([a, b, c, d], [x, y]) = (rows, self.part);
        let (along_upper, along_lower) = (b - a, d - c);
        let (upper, lower) = (along_upper.mul_add(x, a), along_lower.mul_add(x, c));
        let (down, along) = (lower - upper, (along_lower - along_upper).mul_add(y, along_upper));
        let value = down.mul_add(y, upper);
        (
            value.select_or_zero(self.inside),
            [along.select_or_zero(self.inside), down.select_or_zero(self.inside)],
        )
    }

    /// Adds derivatives by the values to those by the four pixels around, where `mask` and inside.
    #[inline(always)]
    pub fn scatter<const C: usize>(
        &self,
        simd: S,
        mask: SimdMask<S>,
        by_values: [SimdVec<S>; C],
        window: &mut GradientWindow<T, C>,
    ) {
        let mut pending = self.inside.and(mask).bitmask();
        if pending == 0 {
            return;
        }
        let ([x, y], one) = (self.part, SimdVec::broadcast(simd, T::one()));
        let mut shares = [[T::zero(); MAX_LANES]; 4];
        ((one - x) * (one - y)).store_to(&mut shares[0], 0);
        (x * (one - y)).store_to(&mut shares[1], 0);
        ((one - x) * y).store_to(&mut shares[2], 0);
        (x * y).store_to(&mut shares[3], 0);
        let mut by = [[T::zero(); MAX_LANES]; C];
        for c in 0..C {
            by_values[c].store_to(&mut by[c], 0);
        }
        while pending != 0 {
            let lane = pending.trailing_zeros() as usize;
            pending &= pending - 1;
            let mut values = [T::zero(); C];
            for c in 0..C {
                values[c] = by[c][lane];
            }
            let first = (self.row[lane] as usize - window.first_row) * window.width + self.col[lane] as usize;
            for (start, k) in [(first, 0), (first + window.width, 2)] {
                let [left, right] = window.data[start..].first_chunk_mut().expect("the next column exists");
                for c in 0..C {
                    left[c] = left[c] + shares[k][lane] * values[c];
                    right[c] = right[c] + shares[k + 1][lane] * values[c];
                }
            }
        }
    }
}

/// The first two pixels.
#[inline(always)]
fn pair<P>(pixels: &[P]) -> &[P; 2] {
    pixels.first_chunk().expect("the next column exists")
}

impl<T: Real, const C: usize> GradientWindow<T, C> {
    /// Becomes zeros at these rows of an image.
    pub fn open(&mut self, width: usize, rows: Range<usize>) {
        (self.width, self.first_row) = (width, rows.start);
        self.data.clear();
        self.data.resize(width * rows.len(), [T::zero(); C]);
    }

    /// A row of the image, if it is one of the window's.
    fn row(&self, row: usize) -> Option<&[[T; C]]> {
        self.data.chunks_exact(self.width.max(1)).nth(row.checked_sub(self.first_row)?)
    }
}

/// `scale` times the sum of the stripes' windows, channels apart again.
pub fn sum_windows<'a, T: Real, const C: usize>(
    sum: &mut Image<T>,
    scale: T,
    window: impl Fn(usize) -> Option<&'a GradientWindow<T, C>> + Sync,
) {
    let width = sum.width;
    sum.data.par_chunks_mut(width * C).enumerate().for_each(|(row, sum)| {
        sum.fill(T::zero());
        for pixels in (0..STRIPES).filter_map(|k| window(k)?.row(row)) {
            for (c, sum) in sum.chunks_exact_mut(width).enumerate() {
                for (sum, by) in sum.iter_mut().zip(pixels) {
                    *sum = *sum + scale * by[c];
                }
            }
        }
    });
}
