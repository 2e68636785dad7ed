//! The loss of the uncertainty of a patch, and its minimum in closed form.

use crate::io::Grid2;
use crate::simd::Real;

/// `D / (2 σ²) + λ log σ + κ (1 - 1 / (2 σ²))²` for a patch of uncertainty σ and dissimilarity D (SatGS, equation 16).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UncertaintyLoss {
    /// λ: weight of log σ, which keeps σ small. SatGS does not state it; WildGaussians has 0.5. At least 0.
    pub prior: f64,
    /// κ: weight of the third term, which draws the visibility towards 1. SatGS writes none, that is 1: then the least visible
    /// patch still has 0.68. Gaussians in the Wild has 0.15, with which it has 0.31, and WildGaussians 0, with which it has 0.25.
    /// At least 0.
    pub visible: f64,
}

impl Default for UncertaintyLoss {
    fn default() -> Self {
        Self { prior: 0.5, visible: 0.15 }
    }
}

impl UncertaintyLoss {
    /// The weights that SatGS prints, and λ of WildGaussians.
    pub const PAPER: Self = Self { prior: 0.5, visible: 1.0 };

    /// The value of `1 / (2 σ²)` that minimises the loss of a patch: the positive root of
    /// `2 κ u² + (D - 2 κ) u - λ / 2 = 0`. Infinite if neither D nor κ bounds it.
    #[must_use]
    pub fn stationary(&self, dissimilarity: f64) -> f64 {
        let Self { prior, visible } = *self;
        let linear = dissimilarity - 2.0 * visible;
        let root = (linear * linear + 4.0 * visible * prior).sqrt();
        // The form that subtracts nothing.
        if linear > 0.0 {
            prior / (root + linear)
        } else if visible > 0.0 {
            (root - linear) / (4.0 * visible)
        } else {
            f64::INFINITY
        }
    }

    /// The visibility, between 0 and 1, of each patch of given dissimilarity: [`UncertaintyLoss::stationary`], at most 1.
    #[must_use]
    pub fn visibility(&self, dissimilarity: &Grid2) -> Grid2 {
        let visibility = |d: &f32| self.stationary(f64::from(*d)).min(1.0) as f32;
        Grid2 { data: dissimilarity.data.iter().map(visibility).collect(), ..*dissimilarity }
    }

    /// The loss of a patch, and its derivative by σ.
    pub(super) fn with_gradient<T: Real>(&self, dissimilarity: T, sigma: T) -> (T, T) {
        let [prior, visible, half] = [self.prior, self.visible, 0.5].map(T::from_f64);
        let certainty = half / (sigma * sigma);
        let hidden = T::one() - certainty;
        let loss = dissimilarity * certainty + prior * sigma.ln() + visible * hidden * hidden;
        // The derivative of 1 / (2 σ²) is -1 / σ³.
        let by_certainty = dissimilarity - (visible + visible) * hidden;
        (loss, (prior - by_certainty / (sigma * sigma)) / sigma)
    }
}

/// The visibility `min(1 / (2 σ²), 1)` of patches of uncertainty σ (SatGS, equation 14).
#[must_use]
pub fn visibility_of_sigma(sigma: &Grid2) -> Grid2 {
    Grid2 { data: sigma.data.iter().map(|s| (0.5 / (s * s)).min(1.0)).collect(), ..*sigma }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WEIGHTS: [f64; 3] = [1.0, 0.15, 0.0];

    #[test]
    fn the_closed_form_has_the_values_of_the_paper() {
        let at = |visible: f64, d: f64| UncertaintyLoss { prior: 0.5, visible }.stationary(d);
        for (found, expected) in
            [(at(1.0, 0.0), 1.11), (at(1.0, 1.0), 0.68), (at(0.15, 1.0), 0.31), (at(0.0, 1.0), 0.25)]
        {
            assert!((found - expected).abs() < 0.005, "{found} {expected}");
        }
        assert_eq!(at(0.0, 0.0), f64::INFINITY);
        let map = UncertaintyLoss::default().visibility(&Grid2 { width: 2, height: 1, data: vec![0.0, 1.0] });
        assert!(map.data[0] == 1.0 && (map.data[1] - 0.3147).abs() < 1e-4, "{:?}", map.data);
    }

    #[test]
    fn no_other_sigma_has_a_smaller_loss_than_the_closed_form() {
        for visible in WEIGHTS {
            for d in [0.02, 0.3, 0.7, 1.0] {
                let loss = UncertaintyLoss { prior: 0.5, visible };
                let minimum = minimum(|sigma| loss.with_gradient(d, sigma).0);
                let sigma = (0.5 / loss.stationary(d)).sqrt();
                assert!((sigma - minimum).abs() < 1e-6, "κ = {visible}, D = {d}: {sigma} {minimum}");
            }
        }
    }

    #[test]
    fn the_derivative_by_sigma_is_that_of_the_loss() {
        for visible in WEIGHTS {
            let loss = UncertaintyLoss { prior: 0.5, visible };
            for (d, sigma) in [(0.1, 0.3), (0.6, 0.9), (1.0, 2.0)] {
                let (step, value) = (1e-5, |s: f64| loss.with_gradient(d, s).0);
                let expected = (value(sigma + step) - value(sigma - step)) / (2.0 * step);
                let found = loss.with_gradient(d, sigma).1;
                assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{found} {expected}");
            }
        }
    }

    /// The minimum of a function with one minimum between 0.05 and 5, by golden sections.
    fn minimum(f: impl Fn(f64) -> f64) -> f64 {
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        let (mut low, mut high) = (0.05, 5.0);
        while high - low > 1e-8 {
            let (a, b) = (high - golden * (high - low), low + golden * (high - low));
            if f(a) < f(b) { high = b } else { low = a }
        }
        0.5 * (low + high)
    }
}
