//! Gradient sums of a splat.

use super::primitive::{Primitive, StoredNumbers};
use crate::simd::Real;

/// Sums over the pixels of a band, or of an image, from which the derivatives with respect to one splat follow.
#[derive(Clone, Copy, Debug)]
pub struct GradientSlot<T: Real, const C: usize, P: Primitive> {
    /// Moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha, where (x, y) is the offset of the pixel from
    /// the ellipse's centre. Of a disc in a perspective projection, each pixel's part is divided by the square of the
    /// plane's denominator there.
    pub(super) moments: [T; MOMENTS],
    /// Derivatives with respect to the features.
    pub(super) feature: [T; C],
    /// Of a disc: the undivided sum of alpha times the derivative by alpha, and the moments 1, x, y of the derivatives by
    /// the number of the plane, which is `z + g . d` or `1 + g . d` (see `primitive`).
    pub(super) slope: P::SlopeSums<T>,
}

/// Number of moments.
pub(super) const MOMENTS: usize = 6;

impl<T: Real, const C: usize, P: Primitive> Default for GradientSlot<T, C, P> {
    fn default() -> Self {
        Self { moments: [T::zero(); MOMENTS], feature: [T::zero(); C], slope: P::SlopeSums::default() }
    }
}

impl<T: Real, const C: usize, P: Primitive> GradientSlot<T, C, P> {
    /// Adds the sums over other pixels.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        add(&mut self.moments, other.moments);
        add(&mut self.feature, other.feature);
        if P::IS_FLAT {
            let mut sum = self.slope.get();
            add(&mut sum, other.slope.get());
            self.slope = P::SlopeSums::of(sum);
        }
    }
}

/// Adds arrays element by element.
#[inline(always)]
pub(super) fn add<T: Real, const N: usize>(sum: &mut [T; N], value: [T; N]) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s = *s + v;
    }
}
