//! From the gradient slots of the bands to the derivatives of each splat.

use super::bands::Band;
use super::footprint::Footprint;
use super::gradient_slot::{GradientSlot, add};
use super::primitive::{Primitive, StoredNumbers};
use super::project::{CHUNK, Chunk};
use super::sorted::SortedSplats;
use super::splat_block::SplatGradient;
use crate::camera::CameraKernel;
use crate::simd::Real;
use rayon::prelude::*;

/// Sets the vector to `n` zeros, in parallel.
pub fn zeros<V: Clone + Default + Send + Sync>(values: &mut Vec<V>, n: usize) {
    values.resize(n, V::default());
    values.par_chunks_mut(1 << 14).for_each(|v| v.fill(V::default()));
}

impl<T: Real, P: Primitive> Chunk<T, P> {
    /// Sums the gradient slots of each splat over the bands, in a fixed order, and adds the derivatives that follow from
    /// them to `gradients` and `by_feature`, both of the chunk's ranks.
    pub fn gather<const C: usize, K: CameraKernel<T>>(
        &mut self,
        index: usize,
        bands: &[Band<T, C, P>],
        sorted: &SortedSplats<T>,
        camera: &K,
        gradients: &mut [SplatGradient<T>],
        by_feature: &mut [[T; C]],
    ) {
        // One sum for each visible splat: this array stays in the cache, and all others are accessed in order.
        let mut sums = [GradientSlot::default(); CHUNK];
        for (b, band) in bands.iter().enumerate() {
            for (span, slot) in self.spans(b).iter().zip(band.slots_of_chunk(index)) {
                sums[span.splat as usize].add(slot);
            }
        }
        self.mean2d_gradients.clear();
        self.mean2d_gradients.resize(gradients.len(), None);
        self.normal_gradients.clear();
        if P::IS_FLAT {
            self.normal_gradients.resize(gradients.len(), [T::zero(); 3]);
        }
        let mut no_normal = [T::zero(); 3];
        for (splat, sum) in self.visible.iter().zip(&sums) {
            let i = splat.rank as usize - self.start;
            let (footprint, rank) = (Footprint::of(splat.footprint), splat.rank as usize);
            let (normal, by_normal) = match P::IS_FLAT {
                true => (sorted.normal(rank), &mut self.normal_gradients[i]),
                false => ([T::zero(); 3], &mut no_normal),
            };
            self.mean2d_gradients[i] = Some(footprint.backward(
                camera,
                sorted.position_and_covariance(rank),
                (normal, splat.slope.get()),
                sum,
                &mut gradients[i],
                by_normal,
            ));
            add(&mut by_feature[i], sum.feature);
        }
    }
}
