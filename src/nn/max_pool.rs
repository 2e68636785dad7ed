//! Maxima over square windows that move by two pixels.

use super::feature_map::{BORDER, FeatureMap, LANES, Pixel16, Stripe};
use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec};
use rayon::prelude::*;

/// Distance between neighbouring windows, pixels.
const STRIDE: usize = 2;

/// The maximum over windows of some columns and rows; pixels after the last whole window are left out.
#[derive(Clone, Copy)]
pub(super) struct MaxPool {
    /// Columns and rows of a window.
    pub(super) side: usize,
}

impl MaxPool {
    /// Columns or rows that are needed for so many windows.
    pub(super) fn input_side(self, windows: usize) -> usize {
        (windows - 1) * STRIDE + self.side
    }

    /// Sets the output: the largest value of each channel in each window. The input has at least the size of one window.
    pub(super) fn forward<T: SimdReal>(self, input: &FeatureMap<T>, output: &mut FeatureMap<T>) {
        let windows = |n: usize| (n - self.side) / STRIDE + 1;
        output.resize(windows(input.width()), windows(input.height()), input.channels());
        let stripes = output.stripes_mut().into_par_iter();
        stripes.for_each(|output| T::dispatch(Forward { side: self.side, input, output }));
    }

    /// Sets the derivatives by the input, from those by the output: that of a window goes to the first pixel, row by row, that
    /// has its maximum.
    pub(super) fn backward<T: SimdReal>(
        self,
        input: &FeatureMap<T>,
        output: &FeatureMap<T>,
        by_output: &FeatureMap<T>,
        by_input: &mut FeatureMap<T>,
    ) {
        by_input.clear(input.width(), input.height(), input.channels());
        // Windows overlap: only whole planes can be computed at the same time.
        by_input.planes_mut().enumerate().for_each(|(block, by_input)| {
            T::dispatch(Backward { side: self.side, block, input, output, by_output, by_input });
        });
    }
}

/// The maxima of a stripe of the output.
struct Forward<'a, T> {
    side: usize,
    input: &'a FeatureMap<T>,
    output: Stripe<'a, T>,
}

impl<T: SimdReal> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        for (k, output) in self.output.rows.into_iter().enumerate() {
            for (col, output) in output.iter_mut().enumerate() {
                for lane in (0..LANES).step_by(S::WIDTH) {
                    let mut max = SimdVec::broadcast(simd, T::neg_infinity());
                    for t in 0..self.side {
                        let row = self.input.row(self.output.block, STRIDE * (self.output.first_row + k) + t);
                        for pixel in &row[STRIDE * col..][..self.side] {
                            max = max.max(SimdVec::load(simd, &pixel[lane..]));
                        }
                    }
                    max.store_to(output, lane);
                }
            }
        }
    }
}

/// The derivatives by a block of the input.
struct Backward<'a, T> {
    side: usize,
    block: usize,
    input: &'a FeatureMap<T>,
    output: &'a FeatureMap<T>,
    by_output: &'a FeatureMap<T>,
    /// The plane with its border.
    by_input: &'a mut [Pixel16<T>],
}

impl<T: SimdReal> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let (side, pitch) = (self.side, self.input.pitch());
        for row in 0..self.output.height() {
            let (outputs, by_outputs) =
                (self.output.row(self.block, row), self.by_output.row(self.block, row));
            for (col, (output, by_output)) in outputs.iter().zip(by_outputs).enumerate() {
                for lane in (0..LANES).step_by(S::WIDTH) {
                    let max = SimdVec::load(simd, &output[lane..]);
                    // What no pixel of the window has got yet.
                    let mut left = SimdVec::load(simd, &by_output[lane..]);
                    for t in 0..side {
                        let inputs = &self.input.row(self.block, STRIDE * row + t)[STRIDE * col..][..side];
                        let first = (STRIDE * row + t + BORDER) * pitch + STRIDE * col + BORDER;
                        for (input, by_input) in inputs.iter().zip(&mut self.by_input[first..]) {
                            let is_max = SimdVec::load(simd, &input[lane..]).greater_equal(max);
                            let share = left.select_or_zero(is_max);
                            (SimdVec::load(simd, &by_input[lane..]) + share).store_to(by_input, lane);
                            left = left - share;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_window_gives_its_gradient_to_its_first_maximum() {
        // Three columns and rows: one window of 3 x 3 pixels, with two maxima.
        let mut input = FeatureMap::<f32>::default();
        input.resize(3, 3, 1);
        for (row, values) in [[0.0, 1.0, 0.0], [0.0, 0.0, 2.0], [2.0, 0.0, 0.0]].iter().enumerate() {
            for (col, value) in values.iter().enumerate() {
                input.stripes_mut()[0].rows[row][col][0] = *value;
            }
        }
        let pool = MaxPool { side: 3 };
        let (mut output, mut by_output, mut by_input) =
            (FeatureMap::default(), FeatureMap::default(), FeatureMap::default());
        pool.forward(&input, &mut output);
        assert_eq!((output.width(), output.height(), output.value(0, 0, 0)), (1, 1, 2.0));
        by_output.resize(1, 1, 1);
        by_output.stripes_mut()[0].rows[0][0][0] = 5.0;
        // What the first call leaves is not added to.
        for _ in 0..2 {
            pool.backward(&input, &output, &by_output, &mut by_input);
        }
        for (row, col) in (0..3).flat_map(|row| (0..3).map(move |col| (row, col))) {
            let expected = if (row, col) == (1, 2) { 5.0 } else { 0.0 };
            assert_eq!(by_input.value(0, col, row), expected, "row {row}, column {col}");
        }
    }
}
