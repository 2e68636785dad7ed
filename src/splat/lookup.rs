//! Looking up, from a view's pixel and its altitude, another camera of the same family: the sun's image, or a
//! virtual view's. A shear carries pixel (col, row) at altitude z to `(col, row) - shear * z - origin`.

use super::raster::Layers;
use super::real::Real;
use std::ops::Range;

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

/// Some rows of an image.
#[derive(Debug, Default)]
pub struct Window<T> {
    /// Row of the image that is the first.
    pub first_row: usize,
    /// The rows.
    pub layers: Layers<T>,
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
    pub fn place(&self, col: usize, row: usize, altitude: T, image: &Layers<T>) -> Option<Place<T>> {
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
    /// Bilinear value of a channel and its slopes by column and row.
    #[inline(always)]
    pub fn value(&self, image: &Layers<T>, channel: usize) -> (T, [T; 2]) {
        let [a, b] = *image.pair(channel, self.col, self.row);
        let [c, d] = *image.pair(channel, self.col, self.row + 1);
        let [x, y] = self.part;
        let (upper, lower) = (a + (b - a) * x, c + (d - c) * x);
        let by_x = (b - a) + ((d - c) - (b - a)) * y;
        (upper + (lower - upper) * y, [by_x, lower - upper])
    }

    /// Adds a derivative by the value to those by the four pixels.
    #[inline(always)]
    pub fn scatter(&self, by: &mut Window<T>, channel: usize, by_value: T) {
        let [x, y] = self.part;
        let one = T::one();
        let row = self.row - by.first_row;
        for (down, share) in [(0, one - y), (1, y)] {
            let [left, right] = by.layers.pair_mut(channel, self.col, row + down);
            *left = *left + (one - x) * share * by_value;
            *right = *right + x * share * by_value;
        }
    }
}
