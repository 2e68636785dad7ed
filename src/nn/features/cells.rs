//! Statistics of gradients and colours in the square cells of a picture.

use super::map::displayed;
use crate::io::Grid2;
use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec, broadcast_each};
use rayon::prelude::*;
use std::f64::consts::FRAC_1_SQRT_2;
use std::ops::Range;

/// Number of orientations that a histogram distinguishes; an edge from dark to bright and one from bright to dark are the same.
pub(super) const ORIENTATIONS: usize = 8;
/// Weights of red, green and blue in the luminance (ITU-R BT.601).
const LUMINANCE: [f32; 3] = [0.299, 0.587, 0.114];
/// Added to colours before the logarithm of their ratios, so that the noise of dark pixels has no colour.
const DARK: f64 = 0.02;
/// Squared gradients below this are rounding errors.
const NO_GRADIENT: f64 = 1e-12;

/// Places of the sums over the pixels of a cell: the histogram, the squared gradient, the luminance, two chromaticities and their
/// squares.
const GRADIENT: usize = ORIENTATIONS;
const LIGHT: usize = GRADIENT + 1;
const CHROMA: usize = LIGHT + 1;
const CHROMA_SQUARE: usize = CHROMA + 2;
const SUMS: usize = CHROMA_SQUARE + 2;

/// Statistics of one cell.
#[derive(Clone, Copy, Default)]
pub(super) struct Cell {
    /// Square roots of gradient magnitudes, by orientation.
    pub orientations: [f32; ORIENTATIONS],
    /// Root mean square of the luminance's gradient, per pixel.
    pub gradient: f32,
    /// Mean luminance.
    pub luminance: f32,
    /// Mean binary logarithms of red by green and of blue by green.
    pub chromaticity: [f32; 2],
    /// Standard deviations of the two logarithms.
    pub deviation: [f32; 2],
}

/// The cells of a picture, row by row. Cells at the right and lower border have those pixels that there are.
pub(super) struct Cells {
    pub width: usize,
    pub height: usize,
    pub cells: Vec<Cell>,
}

impl Cells {
    /// The statistics of a picture of at least one pixel, whose planes have one size, in cells of `cell_px` pixels.
    pub(super) fn of(rgb: &[Grid2; 3], cell_px: usize) -> Self {
        let (columns, rows) = (rgb[0].width, rgb[0].height);
        let (width, height) = (columns.div_ceil(cell_px), rows.div_ceil(cell_px));
        let luminance = padded_luminance(rgb);
        let mut cells = vec![Cell::default(); width * height];
        cells.par_chunks_mut(width).enumerate().for_each(|(k, cells)| {
            let rows = k * cell_px..rows.min((k + 1) * cell_px);
            let mut sums = vec![0.0; SUMS * columns];
            f32::dispatch(ColumnSums { rgb, luminance: &luminance, rows: rows.clone(), sums: &mut sums });
            for (i, cell) in cells.iter_mut().enumerate() {
                let columns = i * cell_px..columns.min((i + 1) * cell_px);
                *cell = Cell::of(&sums, columns, rows.len());
            }
        });
        Self { width, height, cells }
    }

    pub(super) fn at(&self, col: usize, row: usize) -> &Cell {
        &self.cells[row * self.width + col]
    }
}

impl Cell {
    /// The statistics from the sums over `rows` pixels of each column of a picture.
    fn of(sums: &[f32], columns: Range<usize>, rows: usize) -> Self {
        let per_pixel = 1.0 / (columns.len() * rows) as f32;
        let mut lines = sums.chunks_exact(sums.len() / SUMS);
        let mean: [f32; SUMS] = std::array::from_fn(|_| {
            lines.next().map_or(0.0, |line| per_pixel * line[columns.clone()].iter().sum::<f32>())
        });
        let deviation = |k: usize| (mean[CHROMA_SQUARE + k] - mean[CHROMA + k].powi(2)).max(0.0).sqrt();
        Self {
            orientations: std::array::from_fn(|k| mean[k]),
            gradient: mean[GRADIENT].sqrt(),
            luminance: mean[LIGHT],
            chromaticity: [mean[CHROMA], mean[CHROMA + 1]],
            deviation: [deviation(0), deviation(1)],
        }
    }
}

/// The luminance with one more pixel on each side, which repeats its neighbour.
fn padded_luminance(rgb: &[Grid2; 3]) -> Grid2 {
    let (width, height) = (rgb[0].width, rgb[0].height);
    Grid2::from_rows(width + 2, height + 2, |row, line| {
        let row = row.clamp(1, height) - 1;
        let colors = rgb.each_ref().map(|plane| plane.row(row));
        for (i, value) in line[1..=width].iter_mut().enumerate() {
            *value = (0..3).map(|c| LUMINANCE[c] * displayed(colors[c][i])).sum();
        }
        (line[0], line[width + 1]) = (line[1], line[width]);
    })
}

/// The sums over the rows of one row of cells, for each column of the picture: [`SUMS`] lines one after the other.
struct ColumnSums<'a> {
    rgb: &'a [Grid2; 3],
    luminance: &'a Grid2,
    rows: Range<usize>,
    sums: &'a mut [f32],
}

impl SimdKernel<f32> for ColumnSums<'_> {
    #[inline(always)]
    fn run<S: Simd<Scalar = f32>>(self, simd: S) {
        let width = self.rgb[0].width;
        let [zero, one, half, diagonal, dark, no_gradient] =
            broadcast_each(simd, [0.0, 1.0, 0.5, FRAC_1_SQRT_2, DARK, NO_GRADIENT].map(|v| v as f32));
        for start in (0..width).step_by(S::WIDTH) {
            let mut sums = [zero; SUMS];
            for row in self.rows.clone() {
                let padded = |column: usize, below: usize| {
                    SimdVec::load_from(simd, self.luminance.row(row + below), start + column)
                };
                let (east, south) =
                    (half * (padded(2, 1) - padded(0, 1)), half * (padded(1, 2) - padded(1, 0)));
                let square = east * east + south * south;
                // Cosine and sine of twice the orientation: opposite gradients are the same.
                let reciprocal = square.max(no_gradient).reciprocal();
                let cosine = (east * east - south * south) * reciprocal;
                let sine = (east + east) * south * reciprocal;
                let root = square.sqrt().sqrt();
                let axes = [cosine, (cosine + sine) * diagonal, sine, (sine - cosine) * diagonal];
                for (k, axis) in axes.into_iter().enumerate() {
                    // The fourth power of the cosine shares each gradient among the nearest orientations; the shares add up to
                    // the same for all directions.
                    let share = axis * axis * (axis * axis) * root;
                    let positive = share.select_or_zero(axis.greater_than(zero));
                    sums[k] += positive;
                    sums[k + ORIENTATIONS / 2] += share - positive;
                }
                sums[GRADIENT] += square;
                sums[LIGHT] += padded(1, 1);
                let color = |c: usize| {
                    let value = SimdVec::load_from(simd, self.rgb[c].row(row), start);
                    value.select_or_zero(value.greater_than(zero)).min(one) + dark
                };
                let green = color(1);
                for (k, c) in [0, 2].into_iter().enumerate() {
                    let ratio = (color(c) / green).log2();
                    sums[CHROMA + k] += ratio;
                    sums[CHROMA_SQUARE + k] += ratio * ratio;
                }
            }
            for (sum, line) in sums.into_iter().zip(self.sums.chunks_exact_mut(width)) {
                sum.store_to(line, start);
            }
        }
    }
}
