//! The gradient of alpha compositing, front to back.
//!
//! With `g` the loss's derivatives by a pixel's channels and `s_k = f_k . g`, the derivative by the alpha of splat `k` is
//! `T_k s_k - R_k / (1 - alpha_k)`, where `R_k` is the part of `pixel . g` that splats behind splat `k` and the background
//! contribute. `R` starts as `pixel . g` and decreases by `alpha_k T_k s_k` at each splat. The backward pass therefore runs
//! front to back like the forward pass, stops where that stopped, and never divides by a vanishing transmittance, as
//! the back-to-front pass of 3DGS does.

use super::bands::{Band, TileEntry};
use super::batch::{BATCH, Batch, BlockEdges, CAPACITY, GROUP};
use super::block::{BLOCK_WIDTH, BLOCKS_ACROSS, BlockPixels, MAX_BLOCKS, block_height, offset, tile_extents};
use super::forward::KernelConstants;
use super::gradient_slot::{GradientSlot, MOMENTS};
use crate::simd::{
    MAX_LANES, Real, Simd, SimdKernel, SimdReal, SimdVec, arrays_of_lanes, blocks_of_lines, broadcast_each,
    set_bits, sum_fours, transpose_eights, transpose_fours,
};

/// Adds the derivatives that follow from those by a band's pixels to the band's slots.
pub(super) struct Backward<'a, T, const C: usize> {
    pub band: &'a Band<T, C>,
    /// Index of the band in the image.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    /// The rendered pixels of the band: `C` features and the transmittance.
    pub image: &'a [T],
    /// The loss's derivatives by the `C` features of the pixels.
    pub by_pixel: &'a [T],
    /// Buffer for `pixel . g` of each pixel.
    pub products: &'a mut [T],
    pub slots: &'a mut [GradientSlot<T, C>],
}

impl<T: SimdReal, const C: usize> SimdKernel<T> for Backward<'_, T, C> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { band, index, width, image, by_pixel, products, slots } = self;
        dot_pixels_with_gradient::<S, C>(simd, width, image, by_pixel, products);
        let (k, pixels, edges) = (KernelConstants::new(simd), BlockPixels::all(simd), BlockEdges::new(simd));
        let (mut batch, mut alphas) = (Batch::new(), [k.zero; MAX_LANES]);
        let (mut steps, mut sums) = ([[k.zero; 2]; MAX_LANES], [SplatSums::zero(); CAPACITY]);
        for extent in tile_extents(width, by_pixel.len() / (C * width)) {
            band.prefetch(extent.tile);
            let mut states = [BackwardState { transmittance: k.one, remaining: k.zero }; MAX_BLOCKS];
            let mut by_color = [[k.zero; C]; MAX_BLOCKS];
            for down in 0..extent.block_rows::<S>() {
                let products = extent.gather(simd, products, 1, 0, down);
                for across in 0..BLOCKS_ACROSS {
                    states[down * BLOCKS_ACROSS + across].remaining = products[across];
                }
                for c in 0..C {
                    let by = extent.gather(simd, by_pixel, C, c, down);
                    for across in 0..BLOCKS_ACROSS {
                        by_color[down * BLOCKS_ACROSS + across][c] = by[across];
                    }
                }
            }
            let mut translucent = extent.blocks::<S>();
            for entries in band.tile(extent.tile).chunks(BATCH) {
                batch.fill(simd, &edges, entries, extent.tile, index);
                sums[..entries.len()].fill(SplatSums::zero());
                for b in set_bits(translucent) {
                    let mut block = states[b];
                    let block_sums = BlockSums::new(simd, b, &pixels[b], &by_color[b]);
                    for splats in batch.padded_list(b).chunks(S::WIDTH) {
                        if !k.is_translucent(block.transmittance) {
                            translucent &= !(1 << b);
                            break;
                        }
                        k.alphas(&batch, splats, &pixels[b], &mut alphas);
                        for ((splat, alpha), steps) in splats.iter().zip(&alphas).zip(&mut steps) {
                            *steps = block.backward_step(&k, batch.features(*splat), *alpha, &by_color[b]);
                        }
                        for (splats, steps) in splats.as_chunks().0.iter().zip(steps.as_chunks().0) {
                            block_sums.add_to(simd, &mut sums, splats, steps);
                        }
                    }
                    states[b] = block;
                }
                add_to_slots(simd, &batch, entries, &sums, slots);
                if translucent == 0 {
                    break;
                }
            }
        }
    }
}

/// Computes `pixel . g` of each pixel of a band. Whole lines are read in order, which is fast and leaves the derivatives in
/// the cache for the tiles.
#[inline(always)]
fn dot_pixels_with_gradient<S: Simd, const C: usize>(
    simd: S,
    width: usize,
    image: &[S::Scalar],
    by_pixel: &[S::Scalar],
    out: &mut [S::Scalar],
) {
    let inputs = image.chunks(width * (C + 1)).zip(by_pixel.chunks(width * C));
    for (out, (image, by_pixel)) in out.chunks_mut(width).zip(inputs) {
        for first in (0..width).step_by(S::WIDTH) {
            let mut sum = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
            for c in 0..C {
                let channel = c * width..(c + 1) * width;
                let value = SimdVec::load_from(simd, &image[channel.clone()], first);
                sum = value.mul_add(SimdVec::load_from(simd, &by_pixel[channel], first), sum);
            }
            sum.store_to(out, first);
        }
    }
}

/// State of a block's pixels behind the splats that were processed so far.
#[derive(Clone, Copy)]
struct BackwardState<S: Simd> {
    transmittance: SimdVec<S>,
    /// The part `R` of `pixel . g` that lies behind those splats.
    remaining: SimdVec<S>,
}

impl<S: Simd> BackwardState<S> {
    /// Processes the next splat. Returns its weight `alpha T`, and alpha times the derivative by alpha.
    #[inline(always)]
    fn backward_step<const C: usize>(
        &mut self,
        k: &KernelConstants<S>,
        features: [S::Scalar; C],
        unclamped: SimdVec<S>,
        by_color: &[SimdVec<S>; C],
    ) -> [SimdVec<S>; 2] {
        let alpha = unclamped.min(k.alpha_max);
        let clear = k.one - alpha;
        let weight = self.transmittance * alpha;
        self.transmittance = self.transmittance * clear;
        let features = broadcast_each(k.simd, features);
        let mut feature_dot = k.zero;
        for c in 0..C {
            feature_dot = by_color[c].mul_add(features[c], feature_dot);
        }
        let contribution = weight * feature_dot;
        self.remaining = self.remaining - contribution;
        let alpha_by_clear = alpha * clear.reciprocal();
        // Where alpha is clamped it does not depend on the splat.
        [
            weight,
            (contribution - self.remaining * alpha_by_clear)
                .select_or_zero(k.alpha_max.greater_equal(unclamped)),
        ]
    }
}

/// Sums over the pixels of one block for four splats at a time. After a 4 x 4 transpose each vector holds one column of
/// pixels: a group of four lanes is a row of pixels, and each lane of the group a splat.
struct BlockSums<S: Simd, const C: usize> {
    /// Offsets of the columns from the tile's centre, pixels.
    x: [SimdVec<S>; BLOCK_WIDTH],
    /// Squares of these offsets.
    xx: [SimdVec<S>; BLOCK_WIDTH],
    /// Offsets of the rows from the tile's centre, and their squares.
    y: [SimdVec<S>; 2],
    /// The loss's derivatives by each feature of the pixels, column by column.
    by_color: [[SimdVec<S>; BLOCK_WIDTH]; C],
}

impl<S: Simd, const C: usize> BlockSums<S, C> {
    /// For block `b` of the tile.
    #[inline(always)]
    fn new(simd: S, b: usize, at: &BlockPixels<S>, by_color: &[SimdVec<S>; C]) -> Self {
        let mut offsets = [S::Scalar::from_f64(0.0); BLOCK_WIDTH];
        for col in 0..BLOCK_WIDTH {
            offsets[col] = offset(b % BLOCKS_ACROSS * BLOCK_WIDTH + col);
        }
        let x = broadcast_each(simd, offsets);
        let mut xx = x;
        for col in 0..BLOCK_WIDTH {
            xx[col] = x[col] * x[col];
        }
        let mut columns = [x; C];
        for c in 0..C {
            // The derivatives are the same for all four splats.
            columns[c] = transpose_fours([by_color[c]; GROUP]);
        }
        Self { x, xx, y: [at.y, at.yy], by_color: columns }
    }

    /// Adds the sums over the block's pixels to those of four splats, given what [`BackwardState::backward_step`] returned for
    /// each.
    #[inline(always)]
    fn add_to(
        &self,
        simd: S,
        sums: &mut [SplatSums<S::Scalar>; CAPACITY],
        splats: &[u8; GROUP],
        [a, b, c, d]: &[[SimdVec<S>; 2]; GROUP],
    ) {
        const { assert!(C <= GROUP) };
        let v = transpose_fours([a[1], b[1], c[1], d[1]]);
        let w = transpose_fours([a[0], b[0], c[0], d[0]]);
        let sum = (v[0] + v[1]) + (v[2] + v[3]);
        let (x, xx) = (dot(v, self.x), dot(v, self.xx));
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let mut features = [zero; 4];
        for c in 0..C {
            features[c] = dot(w, self.by_color[c]);
        }
        let [y, yy] = self.y;
        let lines = [
            sum_fours([sum, x, xx, sum * y]),
            sum_fours([x * y, sum * yy, zero, zero]),
            sum_fours(features),
            [zero; 2],
        ];
        for part in 0..MAX_LANES / S::WIDTH {
            let mut rows = [zero; 4];
            for k in 0..4 {
                rows[k] =
                    lines[part * block_height::<S>() + k * S::WIDTH / MAX_LANES][k % (MAX_LANES / S::WIDTH)];
            }
            let rows = transpose_fours(blocks_of_lines(rows));
            for j in 0..4 {
                let place = &mut sums[usize::from(splats[j])].numbers;
                let sum = SimdVec::load(simd, &place[part * S::WIDTH..]) + rows[j];
                sum.store_to(place, part * S::WIDTH);
            }
        }
    }
}

/// The dot product of four vectors, as two independent sums that the processor computes in parallel.
#[inline(always)]
fn dot<S: Simd>(a: [SimdVec<S>; BLOCK_WIDTH], b: [SimdVec<S>; BLOCK_WIDTH]) -> SimdVec<S> {
    a[1].mul_add(b[1], a[0] * b[0]) + a[3].mul_add(b[3], a[2] * b[2])
}

/// Sums over a tile's pixels for one splat, with moments about the tile's centre.
#[derive(Clone, Copy)]
struct SplatSums<T> {
    /// Moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha, two unused numbers, and the derivatives by the
    /// features.
    numbers: [T; MAX_LANES],
}

impl<T: Real> SplatSums<T> {
    #[inline(always)]
    fn zero() -> Self {
        Self { numbers: [T::zero(); MAX_LANES] }
    }

    #[inline(always)]
    fn moments(&self) -> &[T; 8] {
        &self.numbers.as_chunks().0[0]
    }

    #[inline(always)]
    fn by_feature(&self) -> &[T; 8] {
        &self.numbers.as_chunks().0[1]
    }
}

/// Adds the sums of a batch to the slots of its splats.
#[inline(always)]
fn add_to_slots<S: Simd, const C: usize>(
    simd: S,
    batch: &Batch<S::Scalar, C>,
    entries: &[TileEntry<S::Scalar, C>],
    sums: &[SplatSums<S::Scalar>; CAPACITY],
    slots: &mut [GradientSlot<S::Scalar, C>],
) {
    for (row, entries) in entries.chunks(S::WIDTH).enumerate() {
        let sums = &sums[row * S::WIDTH..][..S::WIDTH];
        let moments = about_centers(simd, batch.centers(simd, row * S::WIDTH), sums);
        for ((entry, moments), sums) in entries.iter().zip(&moments).zip(sums) {
            let mut slot = GradientSlot::default();
            slot.moments.copy_from_slice(&moments[..MOMENTS]);
            slot.feature.copy_from_slice(&sums.by_feature()[..C]);
            slots[entry.slot as usize].add(&slot);
        }
    }
}

/// Moments about the splats' own centres, from those about the tile's centre; (u, v) are the centres' offsets from the
/// tile's centre. The last two numbers are unused.
#[inline(always)]
fn about_centers<S: Simd>(
    simd: S,
    [u, v]: [SimdVec<S>; 2],
    sums: &[SplatSums<S::Scalar>],
) -> [[S::Scalar; 8]; MAX_LANES] {
    let mut rows = [u; 8];
    for j in 0..8 {
        rows[j] = SimdVec::load_eights(simd, [sums[j].moments(), sums[(j + 8) % S::WIDTH].moments()]);
    }
    let [sum, x, xx, y, xy, yy, ..] = transpose_eights(rows);
    let (by_x, by_y) = (x - u * sum, y - v * sum);
    arrays_of_lanes([
        sum,
        by_x,
        xx - u * (x + by_x),
        by_y,
        xy - u * y - v * by_x,
        yy - v * (y + by_y),
        sum,
        sum,
    ])
}
