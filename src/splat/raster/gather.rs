//! From the gradient slots of the bands to the derivatives of each splat.

use super::bands::Band;
use super::footprint::Footprint;
use super::gradient_slot::{GradientSlot, add};
use super::primitive::{Primitive, StoredNumbers};
use super::project::{CHUNK, Chunk};
use super::sorted::SortedSplats;
use super::splat_block::SplatGradient;
use crate::camera::CameraKernel;
use crate::simd::{Real, Simd, SimdKernel, SimdReal};

/// The gradient of one chunk: sums the gradient slots of each splat over the bands, in a fixed order, and adds the derivatives
/// that follow from them to `gradients` and `by_feature`, both of the chunk's ranks.
///
/// It works splat by splat; as a kernel it is compiled for the instructions of the processor.
pub(super) struct Gather<'a, T: Real, const C: usize, K, P: Primitive> {
    pub chunk: &'a mut Chunk<T, P>,
    /// Index of the chunk.
    pub index: usize,
    pub bands: &'a [Band<T, C, P>],
    pub sorted: &'a SortedSplats<T>,
    pub camera: &'a K,
    pub gradients: &'a mut [SplatGradient<T>],
    pub by_feature: &'a mut [[T; C]],
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>, P: Primitive> SimdKernel<T> for Gather<'_, T, C, K, P> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, _: S) {
        let Self { chunk, index, bands, sorted, camera, gradients, by_feature } = self;
        // One sum for each visible splat: this array stays in the cache, and all others are accessed in order.
        let mut sums = [GradientSlot::default(); CHUNK];
        for (b, band) in bands.iter().enumerate() {
            for (span, slot) in chunk.spans(b).iter().zip(band.slots_of_chunk(index)) {
                sums[span.splat as usize].add(slot);
            }
        }
        chunk.mean2d_gradients.clear();
        chunk.mean2d_gradients.resize(gradients.len(), None);
        chunk.normal_gradients.clear();
        if P::IS_FLAT {
            chunk.normal_gradients.resize(gradients.len(), [T::zero(); 3]);
        }
        let mut no_normal = [T::zero(); 3];
        for (splat, sum) in chunk.visible.iter().zip(&sums) {
            let i = splat.rank as usize - chunk.start;
            let (footprint, rank) = (Footprint::of(splat.footprint), splat.rank as usize);
            let (normal, by_normal) = match P::IS_FLAT {
                true => (sorted.normal(rank), &mut chunk.normal_gradients[i]),
                false => ([T::zero(); 3], &mut no_normal),
            };
            chunk.mean2d_gradients[i] = Some(footprint.backward(
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
