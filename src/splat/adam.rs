//! Adam for the splats, with one learning rate for each parameter group.

use crate::nn::adam::{AdamRule, AdamStep};
use crate::splat::edit::Edit;
use crate::splat::splats::{GROUP_INFO, PerGroup, Splats};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The constants of the splats' parameters (3DGS).
const RULE: AdamRule = AdamRule { epsilon: 1e-15, ..AdamRule::DEFAULT };

/// Number of values that one task works on, and number of splats of an optional group.
const PIECE: usize = 1 << 14;
const SPARSE_PIECE: usize = 512;

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
    ///
    /// Optional groups are large. Of these, splats whose gradient is zero, as it is where a view does not show them, keep
    /// their values and moments (the sparse Adam of 3DGS's program).
    pub fn step(&mut self, splats: &mut Splats, gradient: &Splats, rates: &PerGroup<f64>) {
        self.steps += 1;
        let moments = self.first.groups_mut().into_iter().zip(self.second.groups_mut());
        let groups =
            splats.groups_mut().into_iter().zip(gradient.groups()).zip(moments).zip(rates.to_array());
        for ((((values, gradient), (first, second)), rate), info) in groups.zip(GROUP_INFO) {
            let step = AdamStep::new(RULE, rate, self.steps);
            let piece = if info.is_optional { SPARSE_PIECE * info.width } else { PIECE };
            let moments = first.par_chunks_mut(piece).zip(second.par_chunks_mut(piece));
            let pieces = values.par_chunks_mut(piece).zip(gradient.par_chunks(piece)).zip(moments);
            pieces.for_each(|((values, gradient), (first, second))| {
                let mut run = |range: Range<usize>| {
                    let (first, second) = (&mut first[range.clone()], &mut second[range.clone()]);
                    let (values, gradient) = (&mut values[range.clone()], &gradient[range]);
                    step.update(values, gradient, first, second);
                };
                if info.is_optional {
                    runs_of_nonzero(gradient, info.width).for_each(run);
                } else {
                    run(0..gradient.len());
                }
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

/// Runs of successive splats, with `width` values each, whose gradients are not zero, as ranges of values.
fn runs_of_nonzero(gradient: &[f32], width: usize) -> impl Iterator<Item = Range<usize>> + '_ {
    let is_zero = move |splat: usize| gradient[splat * width..(splat + 1) * width].iter().all(|g| *g == 0.0);
    let count = gradient.len() / width;
    let mut next = 0;
    std::iter::from_fn(move || {
        let start = (next..count).find(|splat| !is_zero(*splat))?;
        let end = (start + 1..count).find(|splat| is_zero(*splat)).unwrap_or(count);
        next = end + 1;
        Some(start * width..end * width)
    })
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

    #[test]
    fn a_tiny_gradient_steps_as_far_as_a_large_one() {
        let (mut g, mut gradient) = (Splats::zeros(2), Splats::zeros(2));
        gradient.opacity_logit = vec![[1.0], [2e-12]];
        let rates = PerGroup { opacity_logit: 0.05, ..PerGroup::default() };
        SplatAdam::new(&g).step(&mut g, &gradient, &rates);
        assert!(g.opacity_logit.iter().all(|l| (l[0] + 0.05).abs() < 1e-4), "{:?}", g.opacity_logit);
    }

    #[test]
    fn harmonics_of_splats_that_a_view_does_not_show_wait() {
        let mut g = Splats::zeros(5);
        g.f_rest.resize(5, [0.0; 45]);
        let mut gradient = g.clone();
        for shown in [1, 2, 4] {
            gradient.f_rest[shown][44] = 2.0;
        }
        let rates = PerGroup { f_rest: 0.1, ..PerGroup::default() };
        let mut adam = SplatAdam::new(&g);
        adam.step(&mut g, &gradient, &rates);
        let moved: Vec<bool> = g.f_rest.iter().map(|f| (f[44] + 0.1).abs() < 1e-6).collect();
        assert_eq!(moved, [false, true, true, false, true]);
        let (values, moments) = (g.f_rest[1], adam.first.f_rest[1]);
        gradient.f_rest[1] = [0.0; 45];
        adam.step(&mut g, &gradient, &rates);
        assert!(g.f_rest[1] == values && adam.first.f_rest[1] == moments && g.f_rest[2] != values);
    }
}
