//! Discs at the pixels of a block: alpha and depth, and the derivatives of one pixel (see `primitive` for the formulas).

use super::bands::TileEntry;
use super::batch::Batch;
use super::block::BlockPixels;
use super::kernel_constants::KernelConstants;
use super::primitive::Primitive;
use crate::camera::{CameraKernel, DepthOrder};
use crate::simd::{MAX_LANES, Real, Simd, SimdMask, SimdVec, broadcast_each};

/// A disc at the pixels of a block.
#[derive(Clone, Copy)]
pub(super) struct DiscSample<S: Simd> {
    /// Alpha, not yet clamped; zero below the cut-off.
    pub alpha: SimdVec<S>,
    /// Depth: altitude in a parallel projection, distance along the camera's axis in a perspective one.
    pub depth: SimdVec<S>,
    /// Mapped depth less the tile's [`reference_depth`]: the altitude, or the reciprocal of the depth.
    pub mapped: SimdVec<S>,
    /// In a perspective projection: reciprocal of the plane's denominator.
    inverse: SimdVec<S>,
    /// In a perspective projection: base-2 logarithm of alpha without the opacity.
    exponent: SimdVec<S>,
}

impl<S: Simd> DiscSample<S> {
    /// A disc that touches no pixel.
    #[inline(always)]
    pub fn none(k: &KernelConstants<S>) -> Self {
        Self { alpha: k.zero, depth: k.zero, mapped: k.zero, inverse: k.zero, exponent: k.zero }
    }
}

/// The mapped depth that the moments of a tile are relative to: that of the centre of its nearest disc. The distortion loss
/// does not depend on it, but moments about zero would lose the differences of depths to rounding.
#[inline(always)]
pub(super) fn reference_depth<T: Real, const C: usize, K: CameraKernel<T>, P: Primitive>(
    entries: &[TileEntry<T, C, P>],
) -> T {
    let depth = entries.first().and_then(|e| e.feature.get(Batch::<T, C, K, P>::DEPTH).copied());
    match (P::MOMENTS, depth) {
        (0, _) | (_, None) => T::zero(),
        (_, Some(depth)) if matches!(K::ORDER, DepthOrder::Altitude) => depth,
        (_, Some(depth)) => depth.recip(),
    }
}

impl<S: Simd> KernelConstants<S> {
    /// Samples of discs of a batch at the pixels of a block.
    #[inline(always)]
    pub fn disc_samples<const C: usize, K: CameraKernel<S::Scalar>, P: Primitive>(
        &self,
        batch: &Batch<S::Scalar, C, K, P>,
        splats: &[u8],
        at: &BlockPixels<S>,
        reference: SimdVec<S>,
        samples: &mut [DiscSample<S>; MAX_LANES],
    ) {
        for (splat, sample) in splats.iter().zip(samples) {
            let plane = batch.plane_at(self.simd, *splat, at);
            let exponent = batch.log2_alpha_at(self.simd, *splat, at);
            if Batch::<S::Scalar, C, K, P>::IS_PERSPECTIVE_DISC {
                let [log2_opacity, mapped] =
                    broadcast_each(self.simd, [batch.log2_opacity(*splat), batch.mapped_depth(*splat)]);
                // Behind the line where the plane meets the camera's plane, its denominator is negative; on it the reciprocal
                // is no number, which even a weight of zero would spread.
                let is_in_front = plane.greater_than(self.zero);
                sample.inverse = plane.reciprocal().select_or_zero(is_in_front);
                sample.exponent = exponent * sample.inverse * sample.inverse;
                let log2_alpha = sample.exponent + log2_opacity;
                let is_seen = log2_alpha.greater_equal(self.log2_cut).and(is_in_front);
                sample.alpha = log2_alpha.exp2_with(&self.exp2).select_or_zero(is_seen);
                let depth = SimdVec::broadcast(self.simd, batch.depth(*splat));
                sample.depth = depth * sample.inverse;
                if P::MOMENTS > 0 {
                    sample.mapped = plane.mul_add(mapped, self.zero - reference);
                }
            } else {
                let is_seen = exponent.greater_equal(self.log2_cut);
                sample.alpha = exponent.exp2_with(&self.exp2).select_or_zero(is_seen);
                sample.depth = plane;
                if P::MOMENTS > 0 {
                    sample.mapped = plane - reference;
                }
            }
        }
    }

    /// Where the transmittance falls to one half: at the splat of the median depth.
    #[inline(always)]
    pub fn is_median(&self, before: SimdVec<S>, after: SimdVec<S>) -> SimdMask<S> {
        before.greater_than(self.half).and(self.half.greater_equal(after))
    }
}

/// Derivatives of the loss by the planes of a block's pixels, but for the transmittance.
#[derive(Clone, Copy)]
pub(super) struct ByPlanes<S: Simd, const C: usize> {
    pub features: [SimdVec<S>; C],
    pub moments: [SimdVec<S>; 2],
    pub median: SimdVec<S>,
}

/// What a block's pixels contribute to the derivatives by one disc.
#[derive(Clone, Copy)]
pub(super) struct DiscStep<S: Simd> {
    /// Weight `alpha T`.
    pub weight: SimdVec<S>,
    /// Alpha times the derivative by alpha.
    pub by_log_alpha: SimdVec<S>,
    /// The same, divided by the square of the plane's denominator.
    pub by_exponent: SimdVec<S>,
    /// Derivative by the plane's number: altitude or denominator.
    pub by_plane: SimdVec<S>,
    /// Derivative by the depth of the centre.
    pub by_depth: SimdVec<S>,
}

impl<S: Simd> DiscStep<S> {
    /// No contribution.
    #[inline(always)]
    pub fn none(k: &KernelConstants<S>) -> Self {
        let zero = k.zero;
        Self { weight: zero, by_log_alpha: zero, by_exponent: zero, by_plane: zero, by_depth: zero }
    }
}

impl<S: Simd> DiscSample<S> {
    /// The contribution of the disc to the product of a pixel and its derivatives, without weight.
    #[inline(always)]
    pub fn dot<const C: usize, P: Primitive>(
        &self,
        k: &KernelConstants<S>,
        features: [S::Scalar; C],
        by: &ByPlanes<S, C>,
    ) -> SimdVec<S> {
        let mut features = broadcast_each(k.simd, features);
        let mut sum = k.zero;
        for c in 0..C {
            if P::is_depth(c, C) {
                features[c] = self.depth;
            }
            sum = by.features[c].mul_add(features[c], sum);
        }
        if P::MOMENTS > 0 {
            let moments = by.moments[1].mul_add(self.mapped, by.moments[0]);
            sum = moments.mul_add(self.mapped, sum);
        }
        sum
    }

    /// The derivatives, given the weight, alpha times the derivative by alpha, and the transmittance before and behind the disc.
    #[inline(always)]
    pub fn step<const C: usize, K: CameraKernel<S::Scalar>, P: Primitive>(
        &self,
        k: &KernelConstants<S>,
        [weight, by_log_alpha]: [SimdVec<S>; 2],
        [before, after]: [SimdVec<S>; 2],
        reference: SimdVec<S>,
        by: &ByPlanes<S, C>,
    ) -> DiscStep<S> {
        let is_perspective = Batch::<S::Scalar, C, K, P>::IS_PERSPECTIVE_DISC;
        let mut by_depth = k.zero;
        for c in 0..C {
            if P::is_depth(c, C) {
                by_depth = by.features[c];
            }
        }
        if P::MOMENTS > 0 {
            let twice = by.moments[1] + by.moments[1];
            let mut by_mapped = twice.mul_add(self.mapped, by.moments[0]);
            if is_perspective {
                // The reciprocal of the depth has the derivative -1 / depth².
                let reciprocal = self.mapped + reference;
                by_mapped = k.zero - by_mapped * reciprocal * reciprocal;
            }
            by_depth += by_mapped;
        }
        by_depth = by_depth * weight;
        if P::MEDIANS > 0 {
            by_depth += by.median.select_or_zero(k.is_median(before, after));
        }
        let (mut by_exponent, mut by_plane) = (by_log_alpha, by_depth);
        if is_perspective {
            by_exponent = by_log_alpha * self.inverse * self.inverse;
            let by_denominator = k.minus_two_ln_2 * by_log_alpha * self.exponent - by_depth * self.depth;
            by_plane = by_denominator * self.inverse;
            by_depth = by_depth * self.inverse;
        }
        DiscStep { weight, by_log_alpha, by_exponent, by_plane, by_depth }
    }
}
