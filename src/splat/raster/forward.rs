//! Alpha compositing of a band, front to back (3DGS, equation 3): a pixel is the sum over its splats of
//! `alpha_k T_k f_k`, where `T_k` is the product of `1 - alpha_j` over the splats in front of splat `k`.
//!
//! The planes of an image are the features, two moments of the mapped depth, the transmittance and the median depth; those
//! that a primitive lacks are left out (`primitive`).

use super::bands::Band;
use super::batch::{BATCH, Batch, BlockEdges};
use super::block::{BLOCKS_ACROSS, BlockPixels, MAX_BLOCKS, tile_extents};
use super::disc::{DiscSample, reference_depth};
use super::kernel_constants::KernelConstants;
use super::primitive::Primitive;
use crate::camera::CameraKernel;
use crate::simd::{MAX_LANES, Real, Simd, SimdKernel, SimdReal, SimdVec, broadcast_each, set_bits};
use std::marker::PhantomData;

/// Renders a band into `out`, whose rows have the planes of the primitive as channels.
pub(super) struct Forward<'a, T: Real, const C: usize, K, P: Primitive> {
    pub band: &'a mut Band<T, C, P>,
    pub kernel: PhantomData<K>,
    /// Index of the band in the image.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    pub background: [T; C],
    pub out: &'a mut [T],
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>, P: Primitive> SimdKernel<T>
    for Forward<'_, T, C, K, P>
{
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { band, index, width, background, out, .. } = self;
        let planes = P::planes(C);
        let (k, pixels, edges) = (KernelConstants::new(simd), BlockPixels::all(simd), BlockEdges::new(simd));
        // Filling whole lines needs no read from memory, and leaves them in the cache for the tiles, which write parts of
        // lines.
        out.fill(T::zero());
        let background = broadcast_each(simd, background);
        let (mut batch, mut alphas) = (Batch::<T, C, K, P>::new(), [k.zero; MAX_LANES]);
        let mut samples = [DiscSample::none(&k); MAX_LANES];
        let mut computed = 0;
        for extent in tile_extents(width, out.len() / (planes * width)) {
            band.prefetch(extent.tile);
            let start = ForwardState {
                transmittance: k.one,
                color: [k.zero; C],
                moments: [k.zero; 2],
                median: k.zero,
            };
            let mut states = [start; MAX_BLOCKS];
            let reference = SimdVec::broadcast(simd, reference_depth::<T, C, K, P>(band.tile(extent.tile)));
            let mut translucent = extent.blocks::<S>();
            for entries in band.tile(extent.tile).chunks(BATCH) {
                batch.fill(simd, &edges, entries, extent.tile, index);
                for b in set_bits(translucent) {
                    let mut block = states[b];
                    for splats in batch.list(b).chunks(S::WIDTH) {
                        if !k.is_translucent(block.transmittance) {
                            translucent &= !(1 << b);
                            break;
                        }
                        computed += splats.len();
                        if P::IS_FLAT {
                            k.disc_samples(&batch, splats, &pixels[b], reference, &mut samples);
                            for (splat, sample) in splats.iter().zip(&samples) {
                                block.composite_disc::<P>(&k, batch.features(*splat), sample);
                            }
                        } else {
                            k.alphas(&batch, splats, &pixels[b], &mut alphas);
                            for (splat, alpha) in splats.iter().zip(&alphas) {
                                block.composite(&k, batch.features(*splat), *alpha);
                            }
                        }
                    }
                    states[b] = block;
                }
                if translucent == 0 {
                    break;
                }
            }
            for down in 0..extent.block_rows::<S>() {
                let mut row = [k.zero; BLOCKS_ACROSS];
                for c in 0..C {
                    for across in 0..BLOCKS_ACROSS {
                        let block = &states[down * BLOCKS_ACROSS + across];
                        row[across] = block.transmittance.mul_add(background[c], block.color[c]);
                    }
                    extent.scatter(out, planes, c, down, row);
                }
                for m in 0..P::MOMENTS {
                    for across in 0..BLOCKS_ACROSS {
                        row[across] = states[down * BLOCKS_ACROSS + across].moments[m];
                    }
                    extent.scatter(out, planes, C + m, down, row);
                }
                for across in 0..BLOCKS_ACROSS {
                    row[across] = states[down * BLOCKS_ACROSS + across].transmittance;
                }
                extent.scatter(out, planes, C + P::MOMENTS, down, row);
                if P::MEDIANS > 0 {
                    for across in 0..BLOCKS_ACROSS {
                        row[across] = states[down * BLOCKS_ACROSS + across].median;
                    }
                    extent.scatter(out, planes, C + P::MOMENTS + 1, down, row);
                }
            }
        }
        band.computed_pairs = S::WIDTH * computed;
    }
}

/// Features and transmittance of a block's pixels behind the splats that were composited so far.
#[derive(Clone, Copy)]
struct ForwardState<S: Simd, const C: usize> {
    transmittance: SimdVec<S>,
    color: [SimdVec<S>; C],
    moments: [SimdVec<S>; 2],
    median: SimdVec<S>,
}

impl<S: Simd, const C: usize> ForwardState<S, C> {
    /// Composites a splat behind those before it.
    #[inline(always)]
    fn composite(&mut self, k: &KernelConstants<S>, features: [S::Scalar; C], unclamped: SimdVec<S>) {
        let alpha = unclamped.min(k.alpha_max);
        let weight = self.transmittance * alpha;
        self.transmittance = self.transmittance * (k.one - alpha);
        let features = broadcast_each(k.simd, features);
        for c in 0..C {
            self.color[c] = weight.mul_add(features[c], self.color[c]);
        }
    }

    /// As [`ForwardState::composite`], for a disc.
    #[inline(always)]
    fn composite_disc<P: Primitive>(
        &mut self,
        k: &KernelConstants<S>,
        features: [S::Scalar; C],
        sample: &DiscSample<S>,
    ) {
        let alpha = sample.alpha.min(k.alpha_max);
        let (before, weight) = (self.transmittance, self.transmittance * alpha);
        self.transmittance = before * (k.one - alpha);
        let mut features = broadcast_each(k.simd, features);
        for c in 0..C {
            if P::is_depth(c, C) {
                features[c] = sample.depth;
            }
            self.color[c] = weight.mul_add(features[c], self.color[c]);
        }
        if P::MOMENTS > 0 {
            let weighted = weight * sample.mapped;
            self.moments[0] += weighted;
            self.moments[1] = weighted.mul_add(sample.mapped, self.moments[1]);
        }
        if P::MEDIANS > 0 {
            self.median += sample.depth.select_or_zero(k.is_median(before, self.transmittance));
        }
    }
}
