//! Warping a view's pixels, with their altitudes, to the image of a sheared camera: the sun's image or a virtual view.
//!
//! A sheared camera is the view's camera with a multiple of the altitude subtracted from its image coordinates. A pixel
//! (col, row) of the view at altitude z appears there at `(col, row) - shear * z - origin`.

use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdMask, SimdVec, broadcast_each};
use crate::splat::raster::{Image, STRIPES};
use rayon::prelude::*;
use std::ops::Range;

/// The map from a view's pixels to the image of a sheared camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShearWarp<T> {
    /// Shear (column, row), pixels per metre of altitude.
    pub shear: [T; 2],
    /// Position (column, row) of the sheared image's first pixel in the view's sheared coordinates, pixels.
    pub origin: [T; 2],
}

/// The places to which a vector of neighbouring pixels is warped, each between four pixels of the sheared image.
pub struct WarpedPixels<S: Simd> {
    /// Which of them lie inside the image; the places of the others are unspecified.
    pub inside: SimdMask<S>,
    col: [u32; MAX_LANES],
    row: [u32; MAX_LANES],
    /// Index of the upper left of the four pixels in the image's data, for the first channel.
    start: [usize; MAX_LANES],
    /// Offsets (right, down) from the upper left pixel, in [0, 1).
    fraction: [SimdVec<S>; 2],
}

/// Some rows of an image to which derivatives are added; the channels of a pixel are adjacent in memory.
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
    /// Warps the pixels of a row from `columns.start` on, one for each lane, to `image`. Lanes beyond `columns.end` count as
    /// outside.
    #[inline(always)]
    pub fn warp<S: Simd<Scalar = T>>(
        &self,
        simd: S,
        columns: Range<usize>,
        row: usize,
        altitude: SimdVec<S>,
        image: &Image<T>,
    ) -> WarpedPixels<S> {
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
        // Places outside the image, and NaN, become zero, so that every place can be read.
        let (x, y) = (x.select_or_zero(inside), y.select_or_zero(inside));
        let (left, top) = (x.floor(), y.floor());
        let (mut col, mut row) = ([0; MAX_LANES], [0; MAX_LANES]);
        left.store_u32(&mut col);
        top.store_u32(&mut row);
        let mut start = [0; MAX_LANES];
        for lane in 0..S::WIDTH {
            start[lane] = row[lane] as usize * image.channels * image.width + col[lane] as usize;
        }
        WarpedPixels { inside, col, row, start, fraction: [x - left, y - top] }
    }

    /// The rows of a sheared image of this height to which the view's pixels of `rows` are warped, given all their
    /// `altitudes`.
    pub fn target_rows<'a>(
        &self,
        rows: Range<usize>,
        altitudes: impl Iterator<Item = &'a T>,
        height: usize,
    ) -> Range<usize> {
        let (low, high) =
            altitudes.fold((T::infinity(), T::neg_infinity()), |(l, h), z| (l.min(*z), h.max(*z)));
        let [a, b] = [low, high].map(|z| self.shear[1] * z + self.origin[1]);
        // One row more on either side allows for rounding.
        let first = T::from_f64(rows.start as f64 - 1.0) - a.max(b);
        let end = T::from_f64(rows.end as f64 + 2.0) - a.min(b);
        let inside = |row: T| row.max(T::zero()).min(T::from_f64(height as f64)).as_u32() as usize;
        inside(first)..inside(end).max(inside(first))
    }

    /// Derivative of sampled values by the altitude of the view's pixels, per metre, from the values' derivatives by column
    /// and row in the sheared image.
    #[inline(always)]
    pub fn altitude_derivative<S: Simd<Scalar = T>>(&self, simd: S, slopes: [SimdVec<S>; 2]) -> SimdVec<S> {
        let [zero, x, y] = broadcast_each(simd, [T::zero(), self.shear[0], self.shear[1]]);
        zero - x * slopes[0] - y * slopes[1]
    }
}

impl<T: Real, S: Simd<Scalar = T>> WarpedPixels<S> {
    /// Bilinearly interpolated values of a channel and their derivatives by column and row; zero outside the image.
    #[inline(always)]
    pub fn sample(&self, simd: S, image: &Image<T>, channel: usize) -> (SimdVec<S>, [SimdVec<S>; 2]) {
        let zero = SimdVec::broadcast(simd, T::zero());
        if !self.inside.any() {
            return (zero, [zero; 2]);
        }
        let mut corners = [[T::zero(); MAX_LANES]; 4];
        let upper = &image.data[channel * image.width..];
        let lower = &upper[image.channels * image.width..];
        for lane in 0..S::WIDTH {
            let [a, b] = *pixel_pair(&upper[self.start[lane]..]);
            let [c, d] = *pixel_pair(&lower[self.start[lane]..]);
            (corners[0][lane], corners[1][lane]) = (a, b);
            (corners[2][lane], corners[3][lane]) = (c, d);
        }
        let mut rows = [zero; 4];
        for k in 0..4 {
            rows[k] = SimdVec::load(simd, &corners[k]);
        }
        let ([a, b, c, d], [x, y]) = (rows, self.fraction);
        let (along_upper, along_lower) = (b - a, d - c);
        let (upper, lower) = (along_upper.mul_add(x, a), along_lower.mul_add(x, c));
        let (down, along) = (lower - upper, (along_lower - along_upper).mul_add(y, along_upper));
        let value = down.mul_add(y, upper);
        (
            value.select_or_zero(self.inside),
            [along.select_or_zero(self.inside), down.select_or_zero(self.inside)],
        )
    }

    /// Adds derivatives by sampled values to those by the four pixels around each place, where `mask` holds and the place is
    /// inside; the transpose of [`WarpedPixels::sample`].
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
        let ([x, y], one) = (self.fraction, SimdVec::broadcast(simd, T::one()));
        let mut weights = [[T::zero(); MAX_LANES]; 4];
        ((one - x) * (one - y)).store_to(&mut weights[0], 0);
        (x * (one - y)).store_to(&mut weights[1], 0);
        ((one - x) * y).store_to(&mut weights[2], 0);
        (x * y).store_to(&mut weights[3], 0);
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
                    left[c] = left[c] + weights[k][lane] * values[c];
                    right[c] = right[c] + weights[k + 1][lane] * values[c];
                }
            }
        }
    }
}

/// Two adjacent pixels.
#[inline(always)]
fn pixel_pair<P>(pixels: &[P]) -> &[P; 2] {
    pixels.first_chunk().expect("the next column exists")
}

impl<T: Real, const C: usize> GradientWindow<T, C> {
    /// Sets the window to zeros over these rows of an image.
    pub fn reset(&mut self, width: usize, rows: Range<usize>) {
        (self.width, self.first_row) = (width, rows.start);
        self.data.clear();
        self.data.resize(width * rows.len(), [T::zero(); C]);
    }

    /// A row of the image, if the window contains it.
    fn row(&self, row: usize) -> Option<&[[T; C]]> {
        self.data.chunks_exact(self.width.max(1)).nth(row.checked_sub(self.first_row)?)
    }
}

/// Writes `scale` times the sum of the stripes' windows to `sum`, which is stored channel by channel.
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
