//! Looking up, from a view's pixel and its altitude, another camera of the same family: the sun's image, or a
//! virtual view's. A shear carries pixel (col, row) at altitude z to `(col, row) - shear * z - origin`.

use super::real::Real;
use std::ops::Range;

/// An image, all channels of a pixel side by side: what is looked up there is used together.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a, T, const C: usize> {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// From one row to the next, pixels.
    pub stride: usize,
    /// The pixels, row by row.
    pub data: &'a [[T; C]],
}

/// How a view's pixels reach another image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lookup<T> {
    /// Pixels per metre of altitude.
    pub shear: [T; 2],
    /// Position of the other image's first pixel in the sheared view, pixels.
    pub origin: [T; 2],
}

/// A place between four pixels of an image.
#[derive(Clone, Copy, Debug)]
pub struct Place<T> {
    col: usize,
    row: usize,
    /// Distance to the pixel at (col, row), in [0, 1].
    part: [T; 2],
}

/// Some rows of an image that derivatives are added to.
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

impl<T: Real> Lookup<T> {
    /// Rows of an image `height` high that pixels of `rows` at altitudes `low..=high` are looked up in.
    pub fn rows(&self, rows: Range<usize>, (low, high): (T, T), height: usize) -> Range<usize> {
        let [a, b] = [low, high].map(|z| self.shear[1] * z + self.origin[1]);
        // A row more on either side, for rounding.
        let first = T::of(rows.start as f64 - 1.0) - a.max(b);
        let end = T::of(rows.end as f64 + 2.0) - a.min(b);
        let inside = |row: T| row.max(T::zero()).min(T::of(height as f64)).small() as usize;
        inside(first)..inside(end).max(inside(first))
    }

    /// Where a pixel at an altitude lies in `image`, unless outside.
    #[inline(always)]
    pub fn place<const C: usize>(
        &self,
        col: usize,
        row: usize,
        altitude: T,
        image: Pixels<T, C>,
    ) -> Option<Place<T>> {
        let x = T::of(col as f64) - self.shear[0] * altitude - self.origin[0];
        let y = T::of(row as f64) - self.shear[1] * altitude - self.origin[1];
        let (right, bottom) = (T::of(image.width as f64 - 1.0), T::of(image.height as f64 - 1.0));
        if !(x >= T::zero() && y >= T::zero() && x < right && y < bottom) {
            return None;
        }
        let (c, r) = (x.floor(), y.floor());
        Some(Place { col: c.small() as usize, row: r.small() as usize, part: [x - c, y - r] })
    }

    /// Derivative of a looked-up value by the altitude, from its slopes by column and row.
    #[inline(always)]
    pub fn by_altitude(&self, slope: [T; 2]) -> T {
        -(self.shear[0] * slope[0] + self.shear[1] * slope[1])
    }
}

impl<T: Real> Place<T> {
    /// Bilinear values of all channels and their slopes by column and row.
    #[inline(always)]
    pub fn values<const C: usize>(&self, image: Pixels<T, C>) -> ([T; C], [[T; 2]; C]) {
        let start = self.row * image.stride + self.col;
        let [a, b] = *pair(&image.data[start..]);
        let [c, d] = *pair(&image.data[start + image.stride..]);
        let [x, y] = self.part;
        let (mut values, mut slopes) = ([T::zero(); C], [[T::zero(); 2]; C]);
        for k in 0..C {
            let (upper, lower) = (a[k] + (b[k] - a[k]) * x, c[k] + (d[k] - c[k]) * x);
            values[k] = upper + (lower - upper) * y;
            slopes[k] = [(b[k] - a[k]) + ((d[k] - c[k]) - (b[k] - a[k])) * y, lower - upper];
        }
        (values, slopes)
    }

    /// Adds derivatives by the values to those by the four pixels.
    #[inline(always)]
    pub fn scatter<const C: usize>(&self, by: &mut Window<T, C>, by_values: [T; C]) {
        let [x, y] = self.part;
        let one = T::one();
        for (row, share) in [(self.row, one - y), (self.row + 1, y)] {
            let start = (row - by.first_row) * by.width + self.col;
            let pair: &mut [[T; C]; 2] = by.data[start..].first_chunk_mut().expect("the next column exists");
            for (pixel, share) in pair.iter_mut().zip([(one - x) * share, x * share]) {
                for (sum, by) in pixel.iter_mut().zip(by_values) {
                    *sum = *sum + share * by;
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
    pub fn row(&self, row: usize) -> Option<&[[T; C]]> {
        self.data.chunks_exact(self.width.max(1)).nth(row.checked_sub(self.first_row)?)
    }
}
