//! The mean binary entropy of the share of sunlight (EOGS's `L_translucentshadows`), which makes each pixel either sunlit or
//! shadowed.

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::{Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, Scaled, stripe_rows};
use rayon::prelude::*;

/// One weight, and one column: the mean entropy in bits.
pub const INFO: TermInfo =
    TermInfo { weights: &["shadow_entropy"], columns: &["shadow_entropy"], scope: TermScope::Any };
/// Inside the logarithms the share of sunlight is clamped to this distance from 0 and 1 (EOGS).
pub const CLIP: f64 = 0.05;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct ShadowEntropy<T> {
    /// Derivatives of each pixel's entropy by its share of sunlight.
    derivatives: Image<T>,
    /// Sum of the entropy over each stripe.
    sums: Vec<f64>,
    /// Weight of one pixel's entropy; none without shadows.
    factor: Option<T>,
}

impl<T: SimdReal> ShadowEntropy<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

impl<T: SimdReal> LossTerm<T> for ShadowEntropy<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        (self.factor, columns[0]) = (None, 0.0);
        let Some(sunlight) = rendered.sunlight else { return 0.0 };
        let Image { width, height, .. } = *sunlight;
        let rows = stripe_rows(height);
        self.derivatives.resize(width, height, 1);
        self.sums.resize(height.div_ceil(rows), 0.0);
        let outputs = self.derivatives.data.par_chunks_mut(rows * width).zip(&mut self.sums);
        outputs.enumerate().for_each(|(k, (derivatives, sum))| {
            T::dispatch(Entropy { sunlight, first_row: k * rows, derivatives, sum });
        });
        let pixels = (width * height) as f64;
        self.factor = Some(T::from_f64(weights[0] / pixels));
        columns[0] = self.sums.iter().sum::<f64>() / pixels;
        weights[0] * columns[0]
    }

    fn by_sunlight(&self) -> Option<Scaled<'_, T>> {
        self.factor.map(|factor| Scaled { image: &self.derivatives, factor })
    }
}

/// The entropy of a stripe: its sum, and its derivatives by the share of sunlight.
struct Entropy<'a, T> {
    sunlight: &'a Image<T>,
    first_row: usize,
    derivatives: &'a mut [T],
    sum: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for Entropy<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { sunlight, first_row, derivatives, sum } = self;
        let width = sunlight.width;
        let [zero, one, low, high] = broadcast_each(simd, [0.0, 1.0, CLIP, 1.0 - CLIP].map(T::from_f64));
        *sum = 0.0;
        for (k, derivatives) in derivatives.chunks_mut(width).enumerate() {
            let mut entropy = zero;
            for start in (0..width).step_by(S::WIDTH) {
                let s = SimdVec::load_from(simd, sunlight.row(0, first_row + k), start);
                // Only the logarithms use the clamped value (EOGS).
                let clipped = s.max(low).min(high);
                let (a, b) = (clipped.log2(), (one - clipped).log2());
                entropy += (s * a + (one - s) * b).select_or_zero(SimdMask::first(simd, width - start));
                (b - a).store_to(derivatives, start);
            }
            *sum -= entropy.sum().as_f64();
        }
    }
}
