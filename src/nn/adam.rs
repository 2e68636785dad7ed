//! Adam (Kingma & Ba 2015, algorithm 1).
//!
//! It is written by hand so that one fused pass updates moments and parameters, with the same result for any number of
//! threads.

use multiversion::multiversion;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Number of values that one task works on.
const PIECE: usize = 1 << 14;

/// Constants of the method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdamRule {
    /// Decay rate of the first moment.
    pub beta1: f32,
    /// Decay rate of the second moment.
    pub beta2: f32,
    /// Added to the denominator.
    pub epsilon: f32,
    /// Whether values whose gradient is zero keep their value and moments.
    pub skips_zeros: bool,
}

impl AdamRule {
    /// The defaults of the paper and of PyTorch.
    pub const DEFAULT: Self = Self { beta1: 0.9, beta2: 0.999, epsilon: 1e-8, skips_zeros: false };
    /// The rule of hash tables (Müller et al. 2022): entries that no item of an iteration touches do not move.
    pub const HASH_TABLES: Self = Self { beta1: 0.9, beta2: 0.99, epsilon: 1e-15, skips_zeros: true };
}

/// Moments of the gradients of some parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u32,
}

impl Adam {
    /// Takes one step with this learning rate.
    pub fn step(&mut self, rule: AdamRule, values: &mut [f32], gradient: &[f32], rate: f64) {
        self.first.resize(gradient.len(), 0.0);
        self.second.resize(gradient.len(), 0.0);
        self.steps += 1;
        let step = AdamStep::new(rule, rate, self.steps);
        let moments = self.first.par_chunks_mut(PIECE).zip(self.second.par_chunks_mut(PIECE));
        let pieces = values.par_chunks_mut(PIECE).zip(gradient.par_chunks(PIECE)).zip(moments);
        pieces.for_each(|((values, gradient), (first, second))| step.update(values, gradient, first, second));
    }

    /// First and second moments, and the number of steps.
    #[must_use]
    pub fn parts(&self) -> (&[f32], &[f32], u32) {
        (&self.first, &self.second, self.steps)
    }

    /// The inverse of [`Adam::parts`].
    #[must_use]
    pub fn of_parts(first: Vec<f32>, second: Vec<f32>, steps: u32) -> Self {
        Self { first, second, steps }
    }

    /// Whether there are moments for so many parameters, or no step was taken yet.
    #[must_use]
    pub fn fits(&self, parameters: usize) -> bool {
        let sizes = [self.first.len(), self.second.len()];
        sizes == [parameters; 2] || (self.steps == 0 && sizes == [0; 2])
    }
}

/// One step of parameters that have taken the same number of steps.
#[derive(Clone, Copy, Debug)]
pub struct AdamStep {
    rule: AdamRule,
    /// Learning rate, divided by the correction of the first moment's bias towards zero.
    rate: f32,
    /// Square root of the correction of the second moment's bias.
    root_second: f32,
}

impl AdamStep {
    /// The step number `steps`, from 1.
    #[must_use]
    pub fn new(rule: AdamRule, rate: f64, steps: u32) -> Self {
        let left = |beta: f32| 1.0 - f64::from(beta).powi(steps as i32);
        let root_second = left(rule.beta2).sqrt() as f32;
        Self { rule, rate: rate as f32 / left(rule.beta1) as f32, root_second }
    }

    /// Learning rate, divided by the correction of the first moment's bias towards zero.
    #[must_use]
    pub fn rate(self) -> f32 {
        self.rate
    }

    /// Square root of the correction of the second moment's bias.
    #[must_use]
    pub fn root_second(self) -> f32 {
        self.root_second
    }

    /// Updates values and moments.
    pub fn update(self, values: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
        if self.rule.skips_zeros {
            update_nonzero(self, values, gradient, first, second);
        } else {
            update(self, values, gradient, first, second);
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn update(by: AdamStep, values: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
    let AdamRule { beta1, beta2, epsilon, .. } = by.rule;
    for (((v, g), m), s) in values.iter_mut().zip(gradient).zip(first).zip(second) {
        *m = beta1 * *m + (1.0 - beta1) * g;
        *s = beta2 * *s + (1.0 - beta2) * g * g;
        *v -= by.rate * *m / (s.sqrt() / by.root_second + epsilon);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn update_nonzero(by: AdamStep, values: &mut [f32], gradient: &[f32], first: &mut [f32], second: &mut [f32]) {
    let AdamRule { beta1, beta2, epsilon, .. } = by.rule;
    for (((v, g), m), s) in values.iter_mut().zip(gradient).zip(first).zip(second) {
        let (new_m, new_s) = (beta1 * *m + (1.0 - beta1) * g, beta2 * *s + (1.0 - beta2) * g * g);
        let new_v = *v - by.rate * new_m / (new_s.sqrt() / by.root_second + epsilon);
        let is_zero = *g == 0.0;
        *m = if is_zero { *m } else { new_m };
        *s = if is_zero { *s } else { new_s };
        *v = if is_zero { *v } else { new_v };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_learning_rate_and_zeros_can_stay() {
        for rule in [AdamRule::DEFAULT, AdamRule::HASH_TABLES] {
            let mut values = [1.0, 1.0, 1.0];
            let mut adam = Adam::default();
            adam.step(rule, &mut values, &[3.0, -1e-2, 0.0], 0.1);
            assert!(values.iter().zip([0.9, 1.1, 1.0]).all(|(a, b)| (a - b).abs() < 1e-5), "{values:?}");
            adam.step(rule, &mut values, &[0.0; 3], 0.1);
            assert_eq!(values[0] == 0.9, rule.skips_zeros, "{values:?}");
        }
    }
}
