//! The mean opacity of the splats (EOGS's `L_opacity`): splats that the images do not need become transparent.

use super::term::{LossTerm, Rendered, TermInfo};
use super::terms::TermInputs;
use crate::simd::SimdReal;
use crate::splat::raster::{SortedSplats, SplatGradient};
use rayon::prelude::*;

/// One weight, and one column: the mean opacity.
pub const INFO: TermInfo = TermInfo { weights: &["opacity"], columns: &["opacity"] };

/// The term.
pub struct Opacity<T> {
    /// Derivative by the opacity of each splat.
    by_opacity: T,
}

impl<T: SimdReal> Opacity<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self { by_opacity: T::zero() }
    }
}

impl<T: SimdReal> LossTerm<T> for Opacity<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns[0] = rendered.sorted.mean_opacity();
        self.by_opacity = T::from_f64(weights[0] / rendered.splats.len().max(1) as f64);
        weights[0] * columns[0]
    }

    fn add_by_sorted(&self, sorted: &SortedSplats<T>, by: &mut [SplatGradient<T>]) {
        by.par_iter_mut().with_min_len(1024).enumerate().for_each(|(rank, by)| {
            by.log_opacity = by.log_opacity + self.by_opacity * sorted.opacity(rank);
        });
    }
}
