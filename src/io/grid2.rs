//! Two-dimensional grids of numbers in memory.

use super::Window;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A two-dimensional grid of f32 values, row by row from the top; NaN marks cells without data.
///
/// It holds one band of an image, or one value for each cell of a map, such as heights. The map position is not part of it
/// (see [`MapGrid`](super::MapGrid)).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Grid2 {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// `width * height` values, row by row.
    pub data: Vec<f32>,
}

impl Grid2 {
    /// A grid whose cells all have one value.
    #[must_use]
    pub fn filled(width: usize, height: usize, value: f32) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }

    /// A grid computed cell by cell from (column, row).
    #[must_use]
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> f32) -> Self {
        let mut data = Vec::with_capacity(width * height);
        for row in 0..height {
            data.extend((0..width).map(|col| f(col, row)));
        }
        Self { width, height, data }
    }

    /// A grid whose rows are computed in parallel; `fill` gets the number of a row and its cells, which are 0.
    #[must_use]
    pub fn from_rows(width: usize, height: usize, fill: impl Fn(usize, &mut [f32]) + Sync) -> Self {
        // Zeroed memory is first accessed by the threads that fill it.
        let mut data = vec![0.0; width * height];
        data.par_chunks_mut(width.max(1)).enumerate().for_each(|(row, line)| fill(row, line));
        Self { width, height, data }
    }

    /// Value at a cell.
    ///
    /// # Panics
    /// Panics if the cell is outside of the grid.
    #[must_use]
    pub fn at(&self, col: usize, row: usize) -> f32 {
        self.data[row * self.width + col]
    }

    /// The values of one row.
    ///
    /// # Panics
    /// Panics if the row is outside of the grid.
    #[must_use]
    pub fn row(&self, row: usize) -> &[f32] {
        &self.data[row * self.width..(row + 1) * self.width]
    }

    /// Value at a cell; NaN outside of the grid.
    #[must_use]
    pub fn get(&self, col: i64, row: i64) -> f32 {
        let inside = (0..self.width as i64).contains(&col) && (0..self.height as i64).contains(&row);
        if inside { self.at(col as usize, row as usize) } else { f32::NAN }
    }

    /// Value at a position, interpolated bilinearly; centres of cells are at whole numbers. NaN outside of the grid, and where
    /// a cell with weight is NaN.
    #[must_use]
    pub fn bilinear(&self, col: f64, row: f64) -> f32 {
        let (c, r) = (col.floor(), row.floor());
        let (fc, fr) = ((col - c) as f32, (row - r) as f32);
        let (c, r) = (c as i64, r as i64);
        // Cells with weight zero are left out, because those outside of the grid are NaN.
        let mix = |a: f32, b: f32, t: f32| if t == 0.0 { a } else { a + (b - a) * t };
        let line = |r: i64| mix(self.get(c, r), if fc == 0.0 { 0.0 } else { self.get(c + 1, r) }, fc);
        mix(line(r), if fr == 0.0 { 0.0 } else { line(r + 1) }, fr)
    }

    /// The part of the grid in a window.
    ///
    /// # Panics
    /// Panics if the window is not inside of the grid.
    #[must_use]
    pub fn window(&self, w: Window) -> Self {
        let rows = (w.row..w.row + w.height).flat_map(|row| &self.row(row)[w.col..w.col + w.width]);
        Self { width: w.width, height: w.height, data: rows.copied().collect() }
    }

    /// The grid at half the size; each cell is the mean of those of its four cells that are not NaN.
    #[must_use]
    pub fn halved(&self) -> Self {
        self.means_of_fours(self.width / 2, self.height / 2)
    }

    /// As [`Grid2::halved`], with the last column and row of a grid with an odd number of them.
    #[must_use]
    pub fn halved_to_the_border(&self) -> Self {
        self.means_of_fours(self.width.div_ceil(2), self.height.div_ceil(2))
    }

    /// Means of squares of two cells a side, of those that are in the grid and not NaN.
    fn means_of_fours(&self, width: usize, height: usize) -> Self {
        Self::from_rows(width, height, |row, line| {
            for (col, mean) in line.iter_mut().enumerate() {
                let (mut sum, mut n) = (0.0f32, 0.0f32);
                for (dc, dr) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let v = self.get((2 * col + dc) as i64, (2 * row + dr) as i64);
                    if !v.is_nan() {
                        sum += v;
                        n += 1.0;
                    }
                }
                *mean = sum / n;
            }
        })
    }

    /// The values that are not NaN, row by row.
    pub fn valid(&self) -> impl Iterator<Item = f32> + '_ {
        self.data.iter().copied().filter(|v| !v.is_nan())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bilinear_is_exact_on_a_ramp_and_nan_outside() {
        let p = Grid2::from_fn(4, 3, |c, r| c as f32 + 10.0 * r as f32);
        assert_eq!(p.bilinear(1.25, 0.5), 6.25);
        assert_eq!(p.bilinear(3.0, 2.0), 23.0);
        assert!(p.bilinear(3.01, 1.0).is_nan());
        assert!(p.bilinear(-0.01, 1.0).is_nan());
    }

    #[test]
    fn halving_skips_nan() {
        let mut p = Grid2::from_fn(2, 2, |c, r| (c + 2 * r) as f32);
        p.data[3] = f32::NAN;
        assert_eq!(p.halved().data, vec![1.0]);
    }
}
