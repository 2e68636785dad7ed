//! Constants of the forward and the backward kernel in registers, and the alphas of a batch.

use super::batch::Batch;
use super::block::BlockPixels;
use super::constants::{ALPHA_CUT, ALPHA_MAX, MIN_TRANSMITTANCE};
use super::primitive::Primitive;
use crate::camera::CameraKernel;
use crate::simd::{Exp2, MAX_LANES, Real, Simd, SimdVec};
use std::hint::black_box;

/// Broadcast constants of the forward and the backward kernel.
pub(super) struct KernelConstants<S: Simd> {
    pub simd: S,
    /// Base-2 logarithm of [`ALPHA_CUT`].
    pub log2_cut: SimdVec<S>,
    min_transmittance: SimdVec<S>,
    pub alpha_max: SimdVec<S>,
    pub zero: SimdVec<S>,
    pub one: SimdVec<S>,
    pub half: SimdVec<S>,
    pub minus_two_ln_2: SimdVec<S>,
    pub exp2: Exp2<S>,
}

impl<S: Simd> KernelConstants<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let broadcast = |v: f64| SimdVec::broadcast(simd, S::Scalar::from_f64(v));
        // `black_box` hides the values from the compiler. It would otherwise broadcast a known number again wherever
        // registers are short, while an instruction can read a vector from memory at no extra cost.
        black_box(Self {
            simd,
            log2_cut: broadcast(ALPHA_CUT.log2()),
            min_transmittance: broadcast(MIN_TRANSMITTANCE),
            alpha_max: broadcast(ALPHA_MAX),
            zero: broadcast(0.0),
            one: broadcast(1.0),
            half: broadcast(0.5),
            minus_two_ln_2: broadcast(-2.0 * std::f64::consts::LN_2),
            exp2: Exp2::new(simd),
        })
    }

    /// Alphas of splats of a batch at the pixels of a block, not yet clamped to [`ALPHA_MAX`].
    ///
    /// They are computed for many splats before the first is composited: the processor overlaps the iterations of so short
    /// a loop.
    #[inline(always)]
    pub fn alphas<const C: usize, K: CameraKernel<S::Scalar>, P: Primitive>(
        &self,
        batch: &Batch<S::Scalar, C, K, P>,
        splats: &[u8],
        at: &BlockPixels<S>,
        alphas: &mut [SimdVec<S>; MAX_LANES],
    ) {
        for (splat, alpha) in splats.iter().zip(alphas) {
            let log2_alpha = batch.log2_alpha_at(self.simd, *splat, at);
            *alpha = log2_alpha.exp2_with(&self.exp2).select_or_zero(log2_alpha.greater_equal(self.log2_cut));
        }
    }

    /// Whether a pixel of a block still transmits at least [`MIN_TRANSMITTANCE`].
    #[inline(always)]
    pub fn is_translucent(&self, transmittance: SimdVec<S>) -> bool {
        transmittance.greater_equal(self.min_transmittance).any()
    }
}
