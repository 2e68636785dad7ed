//! Derivatives by the pixels of an image.

use super::image::Image;
use crate::simd::{Real, Simd, SimdVec};

/// Derivatives by an image's pixels, still to be multiplied by a factor.
#[derive(Clone, Copy, Debug)]
pub struct Scaled<'a, T> {
    /// The derivatives.
    pub image: &'a Image<T>,
    /// The factor.
    pub factor: T,
}

impl<T: Real> Scaled<'_, T> {
    /// Returns `sum` plus the scaled derivatives of a vector of pixels, from column `start` of a row on.
    #[inline(always)]
    pub fn add_to<S: Simd<Scalar = T>>(
        &self,
        simd: S,
        sum: SimdVec<S>,
        channel: usize,
        row: usize,
        start: usize,
    ) -> SimdVec<S> {
        let factor = SimdVec::broadcast(simd, self.factor);
        factor.mul_add(SimdVec::load_from(simd, self.image.row(channel, row), start), sum)
    }
}
