//! From an image to the input of the first convolution, and back for the gradient.
//!
//! The image is normalised and padded by zeros as the first convolution needs it. If that has a stride `s`, the padded image is
//! cut into cells of `s` x `s` pixels, and the `3 s²` values of a cell become the channels of one pixel of the input. A
//! convolution of stride `s` with `n` x `n` kernels is then one of stride 1 with `⌈n / s⌉` x `⌈n / s⌉` kernels, and so is
//! its gradient.

use super::architecture::Architecture;
use super::image::PlanarRgb;
use crate::nn::convolution::{Convolution, KernelShape};
use crate::nn::feature_map::{FeatureMap, LANES};
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;

/// LPIPS normalises red, green and blue in [-1, 1] by `(value - SHIFT) / SCALE` (Zhang et al. 2018, their code, version 0.1:
/// mean and deviation of the images that the networks were trained on).
const SHIFT: [f64; 3] = [-0.030, -0.088, -0.188];
/// See [`SHIFT`].
const SCALE: [f64; 3] = [0.458, 0.448, 0.450];

/// The cutting of images into cells for the first convolution of a network.
#[derive(Clone, Copy)]
pub(super) struct InputCells {
    outputs: usize,
    side: usize,
    padding: usize,
    stride: usize,
}

impl InputCells {
    pub(super) fn new(architecture: &Architecture) -> Self {
        let first = architecture.first;
        let stride = architecture.stride;
        Self { outputs: first.channels, side: first.side, padding: first.padding, stride }
    }

    /// Channels of a cell.
    fn channels(self) -> usize {
        3 * self.stride.pow(2)
    }

    /// Columns and rows of the kernels over cells.
    fn cell_side(self) -> usize {
        self.side.div_ceil(self.stride)
    }

    /// Cells that cover the pixels, of so many columns or rows, from which outputs are computed.
    fn cells(self, pixels: usize) -> usize {
        (pixels + 2 * self.padding - self.side) / self.stride + self.cell_side()
    }

    /// Channel of the image, and row and column in the cell, of a channel of a cell.
    fn place(self, channel: usize) -> (usize, usize, usize) {
        let pixel = channel / 3;
        (channel % 3, pixel / self.stride, pixel % self.stride)
    }

    /// The first convolution, of cells. `weights` are those for pixels: outputs, channels, rows, columns.
    pub(super) fn convolution<T: SimdReal>(self, weights: &[T], bias: &[T]) -> Convolution<T> {
        let Self { outputs, side, stride, .. } = self;
        let shape = KernelShape { inputs: self.channels(), outputs, side: self.cell_side(), padding: 0 };
        let weight = |o: usize, i: usize, t: usize, u: usize| {
            let (channel, row, col) = self.place(i);
            let (t, u) = (t * stride + row, u * stride + col);
            if t < side && u < side { weights[((3 * o + channel) * side + t) * side + u] } else { T::zero() }
        };
        Convolution::new(shape, weight, bias)
    }

    /// Sets the cells of an image.
    pub(super) fn cut<T: SimdReal>(self, image: PlanarRgb<'_, T>, cells: &mut FeatureMap<T>) {
        let Self { padding, stride, .. } = self;
        let (width, height, planes) = (image.width(), image.height(), image.planes());
        let normalisation = normalisation::<T>();
        cells.resize(self.cells(width), self.cells(height), self.channels());
        cells.stripes_mut().into_par_iter().for_each(|mut stripe| {
            let first = stripe.block * LANES;
            for channel in first..self.channels().min(first + LANES) {
                let (c, row_in_cell, col_in_cell) = self.place(channel);
                let (factor, offset) = normalisation[c];
                for (k, cells) in stripe.rows.iter_mut().enumerate() {
                    // Subtraction wraps above and to the left of the image, and so leads outside of it, too.
                    let row = ((stripe.first_row + k) * stride + row_in_cell).wrapping_sub(padding);
                    let pixels = if row < height { &planes[c][row * width..][..width] } else { &[] };
                    for (col, cell) in cells.iter_mut().enumerate() {
                        let pixel = pixels.get((col * stride + col_in_cell).wrapping_sub(padding));
                        cell[channel - first] = pixel.map_or(T::zero(), |p| *p * factor + offset);
                    }
                }
            }
        });
    }

    /// Sets the derivatives by the values of an image of `width` columns and `height` rows (channel after channel, row by row),
    /// from those by its cells.
    pub(super) fn cut_backward<T: SimdReal>(
        self,
        by_cells: &FeatureMap<T>,
        (width, height): (usize, usize),
        by_image: &mut Vec<T>,
    ) {
        let normalisation = normalisation::<T>();
        by_image.resize(3 * width * height, T::zero());
        by_image.par_chunks_exact_mut(width).enumerate().for_each(|(line, by_row)| {
            let (channel, row) = (line / height, line % height + self.padding);
            for (col, by_value) in by_row.iter_mut().enumerate() {
                let by_cell = self.by_cell(by_cells, channel, col + self.padding, row);
                *by_value = by_cell * normalisation[channel].0;
            }
        });
    }

    /// The derivative by a pixel of the padded image; zero for those at the right and lower edge that no output is computed from.
    fn by_cell<T: Real>(self, by_cells: &FeatureMap<T>, channel: usize, col: usize, row: usize) -> T {
        let stride = self.stride;
        let (cell_col, cell_row) = (col / stride, row / stride);
        if cell_col >= by_cells.width() || cell_row >= by_cells.height() {
            return T::zero();
        }
        by_cells.value(3 * (row % stride * stride + col % stride) + channel, cell_col, cell_row)
    }
}

/// Factor and offset from a value in [0, 1] to a normalised one, for each channel.
fn normalisation<T: Real>() -> [(T, T); 3] {
    std::array::from_fn(|c| (T::from_f64(2.0 / SCALE[c]), T::from_f64((-1.0 - SHIFT[c]) / SCALE[c])))
}
