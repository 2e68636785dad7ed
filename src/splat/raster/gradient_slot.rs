//! What the backward pass sums over pixels for each splat.

use crate::simd::Real;

/// Sums over the pixels of a band, or of an image, from which the derivatives with respect to one splat follow.
#[derive(Clone, Copy, Debug)]
pub struct GradientSlot<T, const C: usize> {
    /// Moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha, where (x, y) is the offset of the pixel from
    /// the ellipse's centre.
    pub(super) moments: [T; MOMENTS],
    /// Derivatives with respect to the features.
    pub(super) feature: [T; C],
}

/// Number of moments.
pub(super) const MOMENTS: usize = 6;

impl<T: Real, const C: usize> Default for GradientSlot<T, C> {
    fn default() -> Self {
        Self { moments: [T::zero(); MOMENTS], feature: [T::zero(); C] }
    }
}

impl<T: Real, const C: usize> GradientSlot<T, C> {
    /// Adds the sums over other pixels.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        add(&mut self.moments, other.moments);
        add(&mut self.feature, other.feature);
    }
}

/// Adds arrays element by element.
#[inline(always)]
pub(super) fn add<T: Real, const N: usize>(sum: &mut [T; N], value: [T; N]) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s = *s + v;
    }
}
