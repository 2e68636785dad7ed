//! Adam (Kingma & Ba 2015, algorithm 1), with one learning rate for each parameter group.
//!
//! It is written by hand so that one fused pass updates moments and parameters, with the same result for any number of
//! threads.

use crate::splat::appearance::Appearance;
use crate::splat::edit::Edit;
use crate::splat::splats::{PerGroup, Splats};
use multiversion::multiversion;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Decay rates of the moments (3DGS).
const BETA1: f32 = 0.9;
const BETA2: f32 = 0.999;
/// Added to the denominator for the splats' parameters (3DGS).
const EPSILON: f32 = 1e-15;

/// Moments of the splats' gradients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SplatAdam {
    /// First moments: running means of the gradients.
    pub first: Splats,
    /// Second moments: running means of the squared gradients.
    pub second: Splats,
    /// Number of steps taken.
    pub steps: u32,
}

impl SplatAdam {
    /// Zero moments for these splats.
    #[must_use]
    pub fn new(splats: &Splats) -> Self {
        let mut zeros = Splats::default();
        zeros.resize_like(splats);
        Self { first: zeros.clone(), second: zeros, steps: 0 }
    }

    /// Takes one step with the given learning rate for each parameter group.
    pub fn step(&mut self, splats: &mut Splats, gradient: &Splats, rates: &PerGroup<f64>) {
        self.steps += 1;
        let correction = Correction::after(self.steps);
        let moments = self.first.groups_mut().into_iter().zip(self.second.groups_mut());
        let groups =
            splats.groups_mut().into_iter().zip(gradient.groups()).zip(moments).zip(rates.to_array());
        for (((values, gradient), (first, second)), rate) in groups {
            const PIECE: usize = 1 << 14;
            let moments = first.par_chunks_mut(PIECE).zip(second.par_chunks_mut(PIECE));
            let pieces = values.par_chunks_mut(PIECE).zip(gradient.par_chunks(PIECE)).zip(moments);
            pieces.for_each(|((values, gradient), (first, second))| {
                update(values, gradient, first, second, rate as f32, EPSILON, correction);
            });
        }
    }

    /// Applies an edit of the splats; the moments of new splats are zero.
    pub fn apply(&mut self, edit: &Edit) {
        for moments in [&mut self.first, &mut self.second] {
            moments.apply(edit);
            moments.zero_fresh(edit);
        }
    }
}

/// Moments of the gradients of one view's colour model; they change only in iterations with the view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AppearanceAdam {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u32,
}

impl AppearanceAdam {
    /// Takes one step with the given learning rate.
    pub fn step(&mut self, appearance: &mut Appearance, gradient: &[f32], rate: f64) {
        self.first.resize(gradient.len(), 0.0);
        self.second.resize(gradient.len(), 0.0);
        self.steps += 1;
        let correction = Correction::after(self.steps);
        // PyTorch's default, which EOGS uses for the parameters of the views.
        let epsilon = 1e-8;
        let (first, second) = (&mut self.first, &mut self.second);
        update(&mut appearance.values, gradient, first, second, rate as f32, epsilon, correction);
    }
}

/// Correction of the moments' bias towards zero after some steps.
#[derive(Clone, Copy)]
struct Correction {
    first: f32,
    root_second: f32,
}

impl Correction {
    fn after(steps: u32) -> Self {
        let left = |beta: f32| 1.0 - f64::from(beta).powi(steps as i32);
        Self { first: left(BETA1) as f32, root_second: left(BETA2).sqrt() as f32 }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn update(
    values: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    rate: f32,
    epsilon: f32,
    correction: Correction,
) {
    let step = rate / correction.first;
    for (((v, g), m), s) in values.iter_mut().zip(gradient).zip(first).zip(second) {
        *m = BETA1 * *m + (1.0 - BETA1) * g;
        *s = BETA2 * *s + (1.0 - BETA2) * g * g;
        *v -= step * *m / (s.sqrt() / correction.root_second + epsilon);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_has_the_length_of_the_learning_rate() {
        let mut g = Splats::zeros(1);
        let mut gradient = Splats::zeros(1);
        gradient.position[0] = [3.0, -1e-4, 0.0];
        SplatAdam::new(&g).step(&mut g, &gradient, &PerGroup { position: 0.1, ..PerGroup::default() });
        for (a, b) in g.position[0].iter().zip([-0.1, 0.1, 0.0]) {
            assert!((a - b).abs() < 1e-6, "{:?}", g.position[0]);
        }
    }
}
