//! Looking up, from a view's pixels and their altitudes, another camera of the same family: the sun's image, or a
//! virtual view's. A shear carries pixel (col, row) at altitude z to `(col, row) - shear * z - origin`.

use crate::simd::Real;
use crate::simd::{LANES, Lanes, Mask, Row, splat_each};
use crate::splat::raster::Image;
use rayon::prelude::*;
use std::ops::Range;

/// Runs of rows that scatter into windows of their own; fixed, so that sums do not depend on the threads.
const STRIPES: usize = 8;

/// Rows of a stripe of an image this high.
#[must_use]
pub fn stripe_rows(height: usize) -> usize {
    height.div_ceil(STRIPES)
}

/// How a view's pixels reach another image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShearWarp<T> {
    /// Pixels per metre of altitude.
    pub shear: [T; 2],
    /// Position of the other image's first pixel in the sheared view, pixels.
    pub origin: [T; 2],
}

/// Where neighbouring pixels of a view lie in another image: each between four pixels of it.
pub struct Places<L: Lanes> {
    /// Which of them lie inside; the others' places say nothing.
    pub inside: Mask<L>,
    col: [u32; LANES],
    row: [u32; LANES],
    /// The pixel at (col, row) in the image's first channel.
    start: [usize; LANES],
    /// Distance to the pixel at (col, row), in [0, 1].
    part: [Row<L>; 2],
}

/// Some rows of an image that derivatives are added to, all channels of a pixel side by side.
#[derive(Debug)]
pub struct Window<T, const C: usize> {
    width: usize,
    first_row: usize,
    data: Vec<[T; C]>,
}

impl<T, const C: usize> Default for Window<T, C> {
    fn default() -> Self {
        Self { width: 0, first_row: 0, data: Vec::new() }
    }
}

impl<T: Real> ShearWarp<T> {
    /// Where the pixels at `columns` of a row, as many as there are lanes, lie in `image`.
    #[inline(always)]
    pub fn places<L: Lanes<Number = T>>(
        &self,
        lanes: L,
        columns: Range<usize>,
        row: usize,
        altitude: Row<L>,
        image: &Image<T>,
    ) -> Places<L> {
        let [shear_x, shear_y] = splat_each(lanes, self.shear);
        let (last_col, last_row) = (T::of(image.width as f64 - 1.0), T::of(image.height as f64 - 1.0));
        let [zero, right, bottom] = splat_each(lanes, [T::zero(), last_col, last_row]);
        let (col, row) = (T::of(columns.start as f64), T::of(row as f64));
        let x = Row::splat(lanes, col - self.origin[0]) + Row::numbers(lanes) - shear_x * altitude;
        let y = Row::splat(lanes, row - self.origin[1]) - shear_y * altitude;
        let inside = Mask::first(lanes, columns.len())
            .and(x.at_least(zero))
            .and(y.at_least(zero))
            .and(right.above(x))
            .and(bottom.above(y));
        // Also where it is not a number: every place can be read.
        let (x, y) = (x.keep(inside), y.keep(inside));
        let (left, top) = (x.floor(), y.floor());
        let (mut col, mut row) = ([0; LANES], [0; LANES]);
        left.store_whole(&mut col);
        top.store_whole(&mut row);
        let mut start = [0; LANES];
        for lane in 0..L::WIDTH {
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
        let first = T::of(rows.start as f64 - 1.0) - a.max(b);
        let end = T::of(rows.end as f64 + 2.0) - a.min(b);
        let inside = |row: T| row.max(T::zero()).min(T::of(height as f64)).small() as usize;
        inside(first)..inside(end).max(inside(first))
    }

    /// Derivative of looked-up values by the altitude, from their slopes by column and row.
    #[inline(always)]
    pub fn by_altitude<L: Lanes<Number = T>>(&self, lanes: L, slopes: [Row<L>; 2]) -> Row<L> {
        let [zero, x, y] = splat_each(lanes, [T::zero(), self.shear[0], self.shear[1]]);
        zero - x * slopes[0] - y * slopes[1]
    }
}

impl<T: Real, L: Lanes<Number = T>> Places<L> {
    /// Bilinear values of a channel and their slopes by column and row; zero where outside.
    #[inline(always)]
    pub fn values(&self, lanes: L, image: &Image<T>, channel: usize) -> (Row<L>, [Row<L>; 2]) {
        let zero = Row::splat(lanes, T::zero());
        if !self.inside.any() {
            return (zero, [zero; 2]);
        }
        let mut corners = [[T::zero(); LANES]; 4];
        let upper = &image.data[channel * image.width..];
        let lower = &upper[image.channels * image.width..];
        for lane in 0..L::WIDTH {
            let [a, b] = *pair(&upper[self.start[lane]..]);
            let [c, d] = *pair(&lower[self.start[lane]..]);
            (corners[0][lane], corners[1][lane]) = (a, b);
            (corners[2][lane], corners[3][lane]) = (c, d);
        }
        let mut rows = [zero; 4];
        for k in 0..4 {
            rows[k] = Row::load(lanes, &corners[k]);
        }
        let ([a, b, c, d], [x, y]) = (rows, self.part);
        let (along_upper, along_lower) = (b - a, d - c);
        let (upper, lower) = (along_upper.mul_add(x, a), along_lower.mul_add(x, c));
        let (down, along) = (lower - upper, (along_lower - along_upper).mul_add(y, along_upper));
        let value = down.mul_add(y, upper);
        (value.keep(self.inside), [along.keep(self.inside), down.keep(self.inside)])
    }

    /// Adds derivatives by the values to those by the four pixels around, where `mask` and inside.
    #[inline(always)]
    pub fn scatter<const C: usize>(
        &self,
        lanes: L,
        mask: Mask<L>,
        by_values: [Row<L>; C],
        window: &mut Window<T, C>,
    ) {
        let mut pending = self.inside.and(mask).bits();
        if pending == 0 {
            return;
        }
        let ([x, y], one) = (self.part, Row::splat(lanes, T::one()));
        let mut shares = [[T::zero(); LANES]; 4];
        ((one - x) * (one - y)).store_to(&mut shares[0], 0);
        (x * (one - y)).store_to(&mut shares[1], 0);
        ((one - x) * y).store_to(&mut shares[2], 0);
        (x * y).store_to(&mut shares[3], 0);
        let mut by = [[T::zero(); LANES]; C];
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

impl<T: Real, const C: usize> Window<T, C> {
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
    window: impl Fn(usize) -> Option<&'a Window<T, C>> + Sync,
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
