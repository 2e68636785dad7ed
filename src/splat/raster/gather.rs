//! From the gradient slots of the bands to the derivatives of each splat.

use super::bands::Band;
use super::footprint::Footprint;
use super::gradient_slot::{GradientSlot, add};
use super::project::{CHUNK, Chunk};
use super::sorted::SortedSplats;
use super::splat_block::SplatGradient;
use crate::camera::CameraKernel;
use crate::simd::Real;

impl<T: Real> Chunk<T> {
    /// Sums the gradient slots of each splat over the bands, in a fixed order, and adds the derivatives that follow from
    /// them to `gradients` and `by_feature`, both of the chunk's ranks.
    pub fn gather<const C: usize, K: CameraKernel<T>>(
        &mut self,
        index: usize,
        bands: &[Band<T, C>],
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
        for (splat, sum) in self.visible.iter().zip(&sums) {
            let i = splat.rank as usize - self.start;
            let footprint = Footprint::of(splat.footprint);
            let position_and_covariance = sorted.position_and_covariance(splat.rank as usize);
            self.mean2d_gradients[i] =
                Some(footprint.backward(camera, position_and_covariance, sum, &mut gradients[i]));
            add(&mut by_feature[i], sum.feature);
        }
    }
}
