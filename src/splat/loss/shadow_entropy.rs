//! Entropy of the shares of sunlight (EOGS's `L_translucentshadows`): a pixel is in the sun or in shadow, not between.

use super::surface_prior::Prior;
use super::{LossTerm, Rendered, Scaled, TermInfo};
use crate::simd::{Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, stripe_rows};
use rayon::prelude::*;
use std::sync::Arc;

/// Weight, and column in bits.
pub const INFO: TermInfo = TermInfo { weights: &["shadow_entropy"], columns: &["shadow_entropy"] };
/// Shares of sunlight nearer to 0 or 1 have the entropy of this (EOGS).
const CLIP: f64 = 0.05;

/// The term: the mean binary entropy of the pixels; keeps its buffers.
#[derive(Default)]
pub struct ShadowEntropy<T> {
    /// Derivatives of each pixel's entropy by its share of sunlight.
    slopes: Image<T>,
    /// Sums of the runs of rows.
    sums: Vec<f64>,
    /// Weight of a pixel's entropy; none where shadows are not modelled.
    factor: Option<T>,
}

impl<T: SimdReal> ShadowEntropy<T> {
    /// The term.
    #[must_use]
    pub fn new(_: Option<&Arc<Prior>>) -> Self {
        Self::default()
    }
}

impl<T: SimdReal> LossTerm<T> for ShadowEntropy<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        (self.factor, columns[0]) = (None, 0.0);
        let Some(sunlight) = rendered.sunlight else { return 0.0 };
        let Image { width, height, .. } = *sunlight;
        let rows = stripe_rows(height);
        self.slopes.resize(width, height, 1);
        self.sums.resize(height.div_ceil(rows), 0.0);
        let outputs = self.slopes.data.par_chunks_mut(rows * width).zip(&mut self.sums);
        outputs.enumerate().for_each(|(k, (slopes, sum))| {
            T::dispatch(Entropy { sunlight, first_row: k * rows, slopes, sum });
        });
        let pixels = (width * height) as f64;
        self.factor = Some(T::from_f64(weights[0] / pixels));
        columns[0] = self.sums.iter().sum::<f64>() / pixels;
        weights[0] * columns[0]
    }

    fn by_sunlight(&self) -> Option<Scaled<'_, T>> {
        self.factor.map(|factor| Scaled { image: &self.slopes, factor })
    }
}

/// A run of rows.
struct Entropy<'a, T> {
    sunlight: &'a Image<T>,
    first_row: usize,
    slopes: &'a mut [T],
    sum: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for Entropy<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { sunlight, first_row, slopes, sum } = self;
        let width = sunlight.width;
        let [zero, one, low, high] = broadcast_each(simd, [0.0, 1.0, CLIP, 1.0 - CLIP].map(T::from_f64));
        *sum = 0.0;
        for (k, slopes) in slopes.chunks_mut(width).enumerate() {
            let mut entropy = zero;
            for start in (0..width).step_by(S::WIDTH) {
                let s = SimdVec::load_from(simd, sunlight.row(0, first_row + k), start);
                // The logarithms alone follow the clip.
                let clipped = s.max(low).min(high);
                let (a, b) = (clipped.log2(), (one - clipped).log2());
                entropy += (s * a + (one - s) * b).select_or_zero(SimdMask::first(simd, width - start));
                (b - a).store_to(slopes, start);
            }
            *sum -= entropy.sum().as_f64();
        }
    }
}
