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
use super::disc::{ByPlanes, DiscSample, DiscStep, reference_depth};
use super::gradient_slot::{GradientSlot, MOMENTS};
use super::kernel_constants::KernelConstants;
use super::primitive::{Primitive, StoredNumbers};
use crate::camera::CameraKernel;
use crate::simd::{
    MAX_LANES, Real, Simd, SimdKernel, SimdReal, SimdVec, arrays_of_lanes, blocks_of_lines, broadcast_each,
    set_bits, sum_fours, transpose_eights, transpose_fours,
};
use std::marker::PhantomData;

/// Adds the derivatives that follow from those by a band's pixels to the band's slots.
pub(super) struct Backward<'a, T: Real, const C: usize, K, P: Primitive> {
    pub band: &'a Band<T, C, P>,
    pub kernel: PhantomData<K>,
    /// Index of the band in the image.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    /// The rendered pixels of the band: the planes of the primitive.
    pub image: &'a [T],
    /// The loss's derivatives by the trained planes of the pixels.
    pub by_pixel: &'a [T],
    /// Buffer for `pixel . g` of each pixel.
    pub products: &'a mut [T],
    pub slots: &'a mut [GradientSlot<T, C, P>],
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>, P: Primitive> SimdKernel<T>
    for Backward<'_, T, C, K, P>
{
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { band, index, width, image, by_pixel, products, slots, .. } = self;
        let trained = P::trained_planes(C);
        dot_pixels_with_gradient::<S, C, P>(simd, width, image, by_pixel, products);
        let (k, pixels, edges) = (KernelConstants::new(simd), BlockPixels::all(simd), BlockEdges::new(simd));
        let (mut batch, mut alphas) = (Batch::<T, C, K, P>::new(), [k.zero; MAX_LANES]);
        let (mut steps, mut sums) = ([[k.zero; 2]; MAX_LANES], [SplatSums::zero(); CAPACITY]);
        let (mut samples, mut disc_steps) =
            ([DiscSample::none(&k); MAX_LANES], [DiscStep::none(&k); MAX_LANES]);
        let mut plane_sums = [[T::zero(); 2]; CAPACITY];
        for extent in tile_extents(width, by_pixel.len() / (trained * width)) {
            band.prefetch(extent.tile);
            let mut states = [BackwardState { transmittance: k.one, remaining: k.zero }; MAX_BLOCKS];
            let no_derivatives = ByPlanes { features: [k.zero; C], moments: [k.zero; 2], median: k.zero };
            let mut by_planes = [no_derivatives; MAX_BLOCKS];
            let reference = SimdVec::broadcast(simd, reference_depth::<T, C, K, P>(band.tile(extent.tile)));
            for down in 0..extent.block_rows::<S>() {
                let products = extent.gather(simd, products, 1, 0, down);
                for across in 0..BLOCKS_ACROSS {
                    states[down * BLOCKS_ACROSS + across].remaining = products[across];
                }
                for c in 0..C {
                    let by = extent.gather(simd, by_pixel, trained, c, down);
                    for across in 0..BLOCKS_ACROSS {
                        by_planes[down * BLOCKS_ACROSS + across].features[c] = by[across];
                    }
                }
                for m in 0..P::MOMENTS {
                    let by = extent.gather(simd, by_pixel, trained, C + m, down);
                    for across in 0..BLOCKS_ACROSS {
                        by_planes[down * BLOCKS_ACROSS + across].moments[m] = by[across];
                    }
                }
                if P::MEDIANS > 0 {
                    let by = extent.gather(simd, by_pixel, trained, C + P::MOMENTS + 1, down);
                    for across in 0..BLOCKS_ACROSS {
                        by_planes[down * BLOCKS_ACROSS + across].median = by[across];
                    }
                }
            }
            let mut translucent = extent.blocks::<S>();
            for entries in band.tile(extent.tile).chunks(BATCH) {
                batch.fill(simd, &edges, entries, extent.tile, index);
                sums[..entries.len()].fill(SplatSums::zero());
                if P::IS_FLAT {
                    plane_sums[..entries.len()].fill([T::zero(); 2]);
                }
                for b in set_bits(translucent) {
                    let mut block = states[b];
                    let block_sums = BlockSums::new(simd, b, &pixels[b], &by_planes[b].features);
                    for splats in batch.padded_list(b).chunks(S::WIDTH) {
                        if !k.is_translucent(block.transmittance) {
                            translucent &= !(1 << b);
                            break;
                        }
                        if P::IS_FLAT {
                            k.disc_samples(&batch, splats, &pixels[b], reference, &mut samples);
                            for ((splat, sample), step) in splats.iter().zip(&samples).zip(&mut disc_steps) {
                                let (features, before) = (batch.features(*splat), block.transmittance);
                                let product = sample.dot::<C, P>(&k, features, &by_planes[b]);
                                let weights = block.step(&k, product, sample.alpha);
                                *step = sample.step::<C, K, P>(
                                    &k,
                                    weights,
                                    [before, block.transmittance],
                                    reference,
                                    &by_planes[b],
                                );
                            }
                            for (splats, steps) in splats.as_chunks().0.iter().zip(disc_steps.as_chunks().0) {
                                block_sums.add_discs::<K, P>(simd, &mut sums, &mut plane_sums, splats, steps);
                            }
                            continue;
                        }
                        k.alphas(&batch, splats, &pixels[b], &mut alphas);
                        for ((splat, alpha), steps) in splats.iter().zip(&alphas).zip(&mut steps) {
                            let features = batch.features(*splat);
                            *steps = block.backward_step(&k, features, *alpha, &by_planes[b].features);
                        }
                        for (splats, steps) in splats.as_chunks().0.iter().zip(steps.as_chunks().0) {
                            block_sums.add_to(simd, &mut sums, splats, steps);
                        }
                    }
                    states[b] = block;
                }
                add_to_slots(simd, &batch, entries, &sums, &plane_sums, slots);
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
fn dot_pixels_with_gradient<S: Simd, const C: usize, P: Primitive>(
    simd: S,
    width: usize,
    image: &[S::Scalar],
    by_pixel: &[S::Scalar],
    out: &mut [S::Scalar],
) {
    let trained = P::trained_planes(C);
    // The median depth does not depend on the weights of the splats.
    let planes = trained - if trained > C { P::MEDIANS } else { 0 };
    let inputs = image.chunks(width * P::planes(C)).zip(by_pixel.chunks(width * trained));
    for (out, (image, by_pixel)) in out.chunks_mut(width).zip(inputs) {
        for first in (0..width).step_by(S::WIDTH) {
            let mut sum = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
            for c in 0..planes {
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
        let features = broadcast_each(k.simd, features);
        let mut feature_dot = k.zero;
        for c in 0..C {
            feature_dot = by_color[c].mul_add(features[c], feature_dot);
        }
        self.step(k, feature_dot, unclamped)
    }

    /// As [`BackwardState::backward_step`], given the product of the splat's features and the derivatives.
    #[inline(always)]
    fn step(
        &mut self,
        k: &KernelConstants<S>,
        feature_dot: SimdVec<S>,
        unclamped: SimdVec<S>,
    ) -> [SimdVec<S>; 2] {
        let alpha = unclamped.min(k.alpha_max);
        let clear = k.one - alpha;
        let weight = self.transmittance * alpha;
        self.transmittance = self.transmittance * clear;
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
        let v = transpose_fours([a[1], b[1], c[1], d[1]]);
        let w = transpose_fours([a[0], b[0], c[0], d[0]]);
        let sum = (v[0] + v[1]) + (v[2] + v[3]);
        let (x, xx) = (dot(v, self.x), dot(v, self.xx));
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let mut features = [zero; 8];
        for c in 0..C {
            features[c] = dot(w, self.by_color[c]);
        }
        let [y, yy] = self.y;
        let [f0, f1, f2, f3, f4, f5, f6, f7] = features;
        let lines = [
            sum_fours([sum, x, xx, sum * y]),
            sum_fours([x * y, sum * yy, zero, zero]),
            sum_fours([f0, f1, f2, f3]),
            if C > 4 { sum_fours([f4, f5, f6, f7]) } else { [zero; 2] },
        ];
        add_lines(simd, sums, splats, lines);
    }

    /// As [`BlockSums::add_to`], for discs.
    #[inline(always)]
    fn add_discs<K: CameraKernel<S::Scalar>, P: Primitive>(
        &self,
        simd: S,
        sums: &mut [SplatSums<S::Scalar>; CAPACITY],
        plane_sums: &mut [[S::Scalar; 2]; CAPACITY],
        splats: &[u8; GROUP],
        [a, b, c, d]: &[DiscStep<S>; GROUP],
    ) {
        let v = transpose_fours([a.by_exponent, b.by_exponent, c.by_exponent, d.by_exponent]);
        let w = transpose_fours([a.weight, b.weight, c.weight, d.weight]);
        let plane = transpose_fours([a.by_plane, b.by_plane, c.by_plane, d.by_plane]);
        let total = |v: [SimdVec<S>; BLOCK_WIDTH]| (v[0] + v[1]) + (v[2] + v[3]);
        let (sum, plane_sum) = (total(v), total(plane));
        let (x, xx) = (dot(v, self.x), dot(v, self.xx));
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let is_perspective = Batch::<S::Scalar, C, K, P>::IS_PERSPECTIVE_DISC;
        let mut depth_sum = plane_sum;
        if is_perspective {
            let by_depth = transpose_fours([a.by_depth, b.by_depth, c.by_depth, d.by_depth]);
            depth_sum = total(by_depth);
        }
        let mut features = [zero; 8];
        for c in 0..C {
            features[c] = if P::is_depth(c, C) { depth_sum } else { dot(w, self.by_color[c]) };
        }
        let [y, yy] = self.y;
        let [f0, f1, f2, f3, f4, f5, f6, f7] = features;
        let lines = [
            sum_fours([sum, x, xx, sum * y]),
            sum_fours([x * y, sum * yy, dot(plane, self.x), plane_sum * y]),
            sum_fours([f0, f1, f2, f3]),
            sum_fours([f4, f5, f6, f7]),
        ];
        add_lines(simd, sums, splats, lines);
        let mut more = plane_sum;
        if is_perspective {
            more = total(transpose_fours([a.by_log_alpha, b.by_log_alpha, c.by_log_alpha, d.by_log_alpha]));
        }
        let mut totals = [S::Scalar::from_f64(0.0); MAX_LANES];
        sum_fours([more, plane_sum, zero, zero])[0].store_to(&mut totals, 0);
        for j in 0..GROUP {
            let place = &mut plane_sums[usize::from(splats[j])];
            place[0] = place[0] + totals[j];
            place[1] = place[1] + totals[GROUP + j];
        }
    }
}

/// Adds sums over a block's pixels to those of four splats: sixteen numbers of each, in four lines of [`sum_fours`].
#[inline(always)]
fn add_lines<S: Simd>(
    simd: S,
    sums: &mut [SplatSums<S::Scalar>; CAPACITY],
    splats: &[u8; GROUP],
    lines: [[SimdVec<S>; 2]; 4],
) {
    let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
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

/// The dot product of four vectors, as two independent sums that the processor computes in parallel.
#[inline(always)]
fn dot<S: Simd>(a: [SimdVec<S>; BLOCK_WIDTH], b: [SimdVec<S>; BLOCK_WIDTH]) -> SimdVec<S> {
    a[1].mul_add(b[1], a[0] * b[0]) + a[3].mul_add(b[3], a[2] * b[2])
}

/// Sums over a tile's pixels for one splat, with moments about the tile's centre.
#[derive(Clone, Copy)]
struct SplatSums<T> {
    /// Moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha, the moments x and y of the derivatives by the
    /// planes of discs, and the derivatives by the features.
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
fn add_to_slots<S: Simd, const C: usize, K: CameraKernel<S::Scalar>, P: Primitive>(
    simd: S,
    batch: &Batch<S::Scalar, C, K, P>,
    entries: &[TileEntry<S::Scalar, C, P>],
    sums: &[SplatSums<S::Scalar>; CAPACITY],
    plane_sums: &[[S::Scalar; 2]; CAPACITY],
    slots: &mut [GradientSlot<S::Scalar, C, P>],
) {
    for (row, entries) in entries.chunks(S::WIDTH).enumerate() {
        let sums = &sums[row * S::WIDTH..][..S::WIDTH];
        let moments = about_centers(simd, batch.centers(simd, row * S::WIDTH), sums);
        for (i, ((entry, moments), sums)) in entries.iter().zip(&moments).zip(sums).enumerate() {
            let mut slot = GradientSlot::default();
            slot.moments.copy_from_slice(&moments[..MOMENTS]);
            slot.feature.copy_from_slice(&sums.by_feature()[..C]);
            if P::IS_FLAT {
                let [u, v] = batch.center(row * S::WIDTH + i);
                let [undivided, plane] = plane_sums[row * S::WIDTH + i];
                let [.., x, y] = *sums.moments();
                slot.slope = P::SlopeSums::of([undivided, plane, x - u * plane, y - v * plane]);
            }
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
