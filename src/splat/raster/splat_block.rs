//! What all cameras need of splats, in blocks of lanes, and the derivatives with respect to it.

use crate::simd::{MAX_LANES, Real};

/// Splats of [`MAX_LANES`] successive ranks, one in each lane; aligned, so that each array is loaded into one register.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(super) struct SplatBlock<T> {
    /// Centres in the site frame (east, north, up), metres.
    pub position: [[T; MAX_LANES]; 3],
    /// Covariance elements xx, xy, xz, yy, yz, zz in the site frame, m².
    pub covariance: [[T; MAX_LANES]; 6],
    /// Opacities in [0, 1]; zero in the lanes beyond the last splat.
    pub opacity: [T; MAX_LANES],
}

impl<T: Real> Default for SplatBlock<T> {
    fn default() -> Self {
        let zero = [T::zero(); MAX_LANES];
        Self { position: [zero; 3], covariance: [zero; 6], opacity: zero }
    }
}

/// Derivatives of the loss with respect to what [`SortedSplats`](super::SortedSplats) holds of one splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient<T> {
    /// With respect to the centre (east, north, up), per metre.
    pub position: [T; 3],
    /// With respect to the covariance elements xx, xy, xz, yy, yz, zz, per m². The matrix counts as nine independent
    /// numbers: an off-diagonal value stands for one of its two elements.
    pub covariance: [T; 6],
    /// With respect to the natural logarithm of the opacity.
    pub log_opacity: T,
}
