//! The mean opacity of the splats (EOGS's `L_opacity`), or their sum (IndoorSplat, equation 12): splats that the images do not
//! need become transparent.
//!
//! The sum has a weight of 1e-10 to 1e-9 only, and takes the place of opacity resets. Adam divides a gradient by its own size, so
//! that a splat which no image needs loses opacity at the full learning rate, whatever the weight, while others do not feel it.
//! That relies on the optimiser's small epsilon, and on steps of splats that the view does not show
//! ([`SplatAdam`](crate::splat::adam::SplatAdam)).

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::SimdReal;

/// Weights of the mean and of the sum, and one column: the mean opacity.
pub const INFO: TermInfo =
    TermInfo { weights: &["opacity", "opacity_sum"], columns: &["opacity"], scope: TermScope::Any };

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
        columns[0] = rendered.mean_opacity;
        let splats = rendered.splats.len() as f64;
        self.by_opacity = T::from_f64(weights[0] / splats.max(1.0) + weights[1]);
        (weights[0] + weights[1] * splats) * columns[0]
    }

    fn by_opacity(&self) -> T {
        self.by_opacity
    }
}
