//! The gradient of an iteration whose view shows only some of the splats.

use super::splats::{Splats, opacities};
use crate::simd::SimdReal;
use std::ops::Range;

/// Derivatives of the loss by the parameters of the splats that a view may show, and by the opacities of the others.
#[derive(Clone, Debug, Default)]
pub struct SeenGradient<T = f32> {
    /// Indices of the splats that the view may show among all splats, rising.
    pub indices: Vec<u32>,
    /// Their derivatives, in this order.
    pub of_seen: Splats<T>,
    /// Derivative by the opacity of each of the others.
    pub by_opacity: T,
}

impl<T: SimdReal> SeenGradient<T> {
    /// The places in [`SeenGradient::indices`] of splats with indices in a range.
    #[must_use]
    pub fn places(&self, splats: Range<usize>) -> Range<usize> {
        let before = |end: usize| self.indices.partition_point(|index| (*index as usize) < end);
        before(splats.start)..before(splats.end)
    }

    /// Writes the derivatives by the logits of the opacities of all splats from index `first` on.
    pub fn write_by_logits(&self, first: usize, logits: &[[T; 1]], out: &mut [[T; 1]]) {
        opacities(logits, out.as_flattened_mut());
        for [out] in out.iter_mut() {
            let opacity = *out;
            *out = self.by_opacity * opacity * (T::one() - opacity);
        }
        for place in self.places(first..first + logits.len()) {
            out[self.indices[place] as usize - first] = self.of_seen.opacity_logit[place];
        }
    }

    /// The derivatives of all splats, zero but for the opacities of those that are not seen.
    #[must_use]
    pub fn of_all(&self, splats: &Splats<T>) -> Splats<T> {
        let mut out = Splats::default();
        out.resize_like(splats);
        for ((out, seen), info) in
            out.groups_mut().into_iter().zip(self.of_seen.groups()).zip(super::splats::GROUP_INFO)
        {
            for (values, index) in seen.chunks_exact(info.width).zip(&self.indices) {
                out[*index as usize * info.width..][..info.width].copy_from_slice(values);
            }
        }
        self.write_by_logits(0, &splats.opacity_logit, &mut out.opacity_logit);
        out
    }
}
