//! Feature maps: what convolutions read and write.
//!
//! Channels are stored in blocks of [`LANES`]. Each block is a plane, and each pixel of a plane is an array of the block's
//! channels, so that kernels compute with vectors over channels. Planes have a border of zeros, which is the padding of
//! convolutions. Lanes after the last channel are zero.

use crate::simd::{MAX_LANES, Real, Simd, SimdKernel, SimdReal, SimdVec};
use rayon::prelude::*;

/// Channels of a block.
pub(super) const LANES: usize = MAX_LANES;
/// Width of the border of zeros, pixels; the largest padding that a convolution may have.
pub(super) const BORDER: usize = 2;
/// Pixels after the last plane: a kernel may read, but not use, up to so many pixels after the end of a row.
pub(super) const SLACK: usize = 8;
/// About how many pixels of a plane are computed as one task.
const STRIPE_PIXELS: usize = 512;

/// The channels of one block at one pixel.
pub(super) type Pixel16<T> = [T; LANES];

/// Channels of equal size, in blocks of [`LANES`].
#[derive(Clone, Default)]
pub(super) struct FeatureMap<T> {
    width: usize,
    height: usize,
    channels: usize,
    data: Vec<Pixel16<T>>,
}

/// Some rows of a block: what one task computes.
pub(super) struct Stripe<'a, T> {
    /// Index of the block.
    pub(super) block: usize,
    /// Index of the first row.
    pub(super) first_row: usize,
    /// The rows without the borders at their sides.
    pub(super) rows: Vec<&'a mut [Pixel16<T>]>,
}

impl<T: Real> FeatureMap<T> {
    /// Columns, without the border.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// Rows, without the border.
    pub(super) fn height(&self) -> usize {
        self.height
    }

    /// Number of channels.
    pub(super) fn channels(&self) -> usize {
        self.channels
    }

    /// Number of blocks.
    pub(super) fn blocks(&self) -> usize {
        self.channels.div_ceil(LANES)
    }

    /// Distance from a pixel to the one below it in [`FeatureMap::pixels`].
    pub(super) fn pitch(&self) -> usize {
        self.width + 2 * BORDER
    }

    /// Distance from a pixel to the same one of the next block in [`FeatureMap::pixels`].
    pub(super) fn plane_len(&self) -> usize {
        self.pitch() * (self.height + 2 * BORDER)
    }

    /// All pixels of all planes with their borders, and [`SLACK`].
    pub(super) fn pixels(&self) -> &[Pixel16<T>] {
        &self.data
    }

    /// Index in [`FeatureMap::pixels`] of a pixel of the first block.
    pub(super) fn index(&self, col: usize, row: usize) -> usize {
        (row + BORDER) * self.pitch() + col + BORDER
    }

    /// Gives the map a size. Values are unspecified, except in borders and in lanes after the last channel: these are zero as
    /// long as nothing else is written there.
    pub(super) fn resize(&mut self, width: usize, height: usize, channels: usize) {
        if (width, height, channels) != (self.width, self.height, self.channels) {
            self.clear(width, height, channels);
        }
    }

    /// Gives the map a size and sets all values to zero.
    pub(super) fn clear(&mut self, width: usize, height: usize, channels: usize) {
        (self.width, self.height, self.channels) = (width, height, channels);
        let len = self.plane_len() * self.blocks() + SLACK;
        self.data.clear();
        self.data.resize(len, [T::zero(); LANES]);
    }

    /// A row of a block, without the border.
    pub(super) fn row(&self, block: usize, row: usize) -> &[Pixel16<T>] {
        &self.data[block * self.plane_len() + self.index(0, row)..][..self.width]
    }

    /// The value of a channel at a pixel.
    pub(super) fn value(&self, channel: usize, col: usize, row: usize) -> T {
        self.row(channel / LANES, row)[col][channel % LANES]
    }

    /// The planes with their borders, one for each block.
    pub(super) fn planes_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [Pixel16<T>]> {
        let len = self.plane_len();
        let all = len * self.blocks();
        self.data[..all].par_chunks_exact_mut(len.max(1))
    }

    /// All blocks in stripes of a few rows. The division depends on the size of the map only.
    pub(super) fn stripes_mut(&mut self) -> Vec<Stripe<'_, T>> {
        let (pitch, width, height, plane_len) = (self.pitch(), self.width, self.height, self.plane_len());
        let stripe_rows = (STRIPE_PIXELS / width.max(1)).max(1).next_multiple_of(2);
        let mut stripes = Vec::new();
        for (block, plane) in self.data.chunks_exact_mut(plane_len.max(1)).enumerate() {
            let mut rows = plane.chunks_exact_mut(pitch).skip(BORDER).take(height);
            for first_row in (0..height).step_by(stripe_rows) {
                let rows = rows.by_ref().take(stripe_rows).map(|row| &mut row[BORDER..][..width]).collect();
                stripes.push(Stripe { block, first_row, rows });
            }
        }
        stripes
    }
}

impl<T: SimdReal> FeatureMap<T> {
    /// Sets the derivatives by the inputs of a ReLU, from those by its outputs in `self`: those of zero outputs become zero.
    pub(super) fn relu_backward(&mut self, outputs: &Self) {
        self.stripes_mut().into_par_iter().for_each(|by| T::dispatch(ReluBackward { outputs, by }));
    }
}

/// The derivatives of a stripe by the inputs of a ReLU.
struct ReluBackward<'a, T> {
    outputs: &'a FeatureMap<T>,
    by: Stripe<'a, T>,
}

impl<T: SimdReal> SimdKernel<T> for ReluBackward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let zero = SimdVec::broadcast(simd, T::zero());
        for (k, by) in self.by.rows.into_iter().enumerate() {
            let outputs = self.outputs.row(self.by.block, self.by.first_row + k);
            for (by, output) in by.iter_mut().zip(outputs) {
                for lane in (0..LANES).step_by(S::WIDTH) {
                    let is_active = SimdVec::load(simd, &output[lane..]).greater_than(zero);
                    SimdVec::load(simd, &by[lane..]).select_or_zero(is_active).store_to(by, lane);
                }
            }
        }
    }
}
