//! Adam for the splats, with one learning rate for each parameter group.

use crate::nn::adam::{AdamRule, AdamStep};
use crate::splat::edit::Edit;
use crate::splat::seen_gradient::SeenGradient;
use crate::splat::splats::{GROUP_INFO, PerGroup, Splats};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The constants of the splats' parameters (3DGS).
pub const RULE: AdamRule = AdamRule { epsilon: 1e-15, ..AdamRule::DEFAULT };

/// Number of values that one task works on, and number of splats where only some are seen.
const PIECE: usize = 1 << 14;
const SPLATS_PIECE: usize = 1 << 12;
/// The parameter group that a loss term changes for all splats, seen or not.
const OPACITY: &str = "opacity_logit";

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
        let moments = self.first.groups_mut().into_iter().zip(self.second.groups_mut());
        let groups =
            splats.groups_mut().into_iter().zip(gradient.groups()).zip(moments).zip(rates.to_array());
        for (((values, gradient), (first, second)), rate) in groups {
            let step = AdamStep::new(RULE, rate, self.steps);
            let moments = first.par_chunks_mut(PIECE).zip(second.par_chunks_mut(PIECE));
            let pieces = values.par_chunks_mut(PIECE).zip(gradient.par_chunks(PIECE)).zip(moments);
            pieces.for_each(|((values, gradient), (first, second))| {
                step.update(values, gradient, first, second);
            });
        }
    }

    /// Takes one step with the gradient of a view that shows some of the splats.
    ///
    /// The others keep their values and moments (the sparse Adam of 3DGS's program), except for their opacities, which a loss term
    /// of all splats may change. Optional groups are large: of these, splats whose gradient is zero wait too.
    pub fn step_seen(&mut self, splats: &mut Splats, gradient: &SeenGradient, rates: &PerGroup<f64>) {
        self.steps += 1;
        self.step_logits(&mut splats.opacity_logit, gradient, rates.opacity_logit);
        let moments = self.first.groups_mut().into_iter().zip(self.second.groups_mut());
        let groups =
            splats.groups_mut().into_iter().zip(gradient.of_seen.groups()).zip(moments).zip(rates.to_array());
        for ((((values, of_seen), (first, second)), rate), info) in groups.zip(GROUP_INFO) {
            if info.name == OPACITY {
                continue;
            }
            let (step, width) = (AdamStep::new(RULE, rate, self.steps), info.width);
            let piece = SPLATS_PIECE * width;
            let moments = first.par_chunks_mut(piece).zip(second.par_chunks_mut(piece));
            values.par_chunks_mut(piece).zip(moments).enumerate().for_each(
                |(k, (values, (first, second)))| {
                    let start = k * SPLATS_PIECE;
                    let places = gradient.places(start..start + values.len() / width);
                    let (indices, mut of_seen) =
                        (&gradient.indices[places.clone()], &of_seen[places.start * width..]);
                    for run in indices.chunk_by(|a, b| a + 1 == *b) {
                        let (own, others) = of_seen.split_at(run.len() * width);
                        let first_value = (run[0] as usize - start) * width;
                        let at = first_value..first_value + own.len();
                        let (values, first) = (&mut values[at.clone()], &mut first[at.clone()]);
                        if info.is_optional {
                            update_nonzero_rows(step, width, values, own, (first, &mut second[at]));
                        } else {
                            step.update(values, own, first, &mut second[at]);
                        }
                        of_seen = others;
                    }
                },
            );
        }
    }

    /// The step of the opacities of all splats.
    fn step_logits(&mut self, logits: &mut [[f32; 1]], gradient: &SeenGradient, rate: f64) {
        let step = AdamStep::new(RULE, rate, self.steps);
        let (first, second) = (&mut self.first.opacity_logit, &mut self.second.opacity_logit);
        let moments = first.par_chunks_mut(SPLATS_PIECE).zip(second.par_chunks_mut(SPLATS_PIECE));
        logits.par_chunks_mut(SPLATS_PIECE).zip(moments).enumerate().for_each(
            |(k, (logits, (first, second)))| {
                let mut by_logits = [[0.0; 1]; SPLATS_PIECE];
                let by_logits = &mut by_logits[..logits.len()];
                gradient.write_by_logits(k * SPLATS_PIECE, logits, by_logits);
                let moments = (first.as_flattened_mut(), second.as_flattened_mut());
                step.update(logits.as_flattened_mut(), by_logits.as_flattened(), moments.0, moments.1);
            },
        );
    }

    /// Applies an edit of the splats; the moments of new splats are zero.
    pub fn apply(&mut self, edit: &Edit) {
        for moments in [&mut self.first, &mut self.second] {
            moments.apply(edit);
            moments.zero_fresh(edit);
        }
    }
}

impl SplatAdam {
    /// Gives new splats the second moments that the opacities of their sources had `before` an edit.
    ///
    /// Adam divides a gradient by its size. A new splat without moments, which no view has shown yet, has only the tiny gradient of the
    /// sum of opacities: it would lose its opacity, several times as fast as the learning rate says, before an image shows that it is
    /// needed.
    pub fn keep_size_of_opacity_gradients(&mut self, edit: &Edit, before: &[[f32; 1]]) {
        let now = self.second.opacity_logit.iter_mut().zip(&edit.source);
        for (moment, source) in now.skip(edit.fresh_from) {
            *moment = before[*source as usize];
        }
    }
}

/// Updates the splats, with `width` values each, whose gradient is not zero.
fn update_nonzero_rows(
    step: AdamStep,
    width: usize,
    values: &mut [f32],
    gradient: &[f32],
    (first, second): (&mut [f32], &mut [f32]),
) {
    let moments = first.chunks_exact_mut(width).zip(second.chunks_exact_mut(width));
    let rows = values.chunks_exact_mut(width).zip(gradient.chunks_exact(width)).zip(moments);
    for ((values, gradient), (first, second)) in rows.filter(|row| row.0.1.iter().any(|g| *g != 0.0)) {
        step.update(values, gradient, first, second);
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

    #[test]
    fn a_tiny_gradient_steps_as_far_as_a_large_one() {
        let (mut g, mut gradient) = (Splats::zeros(2), Splats::zeros(2));
        gradient.opacity_logit = vec![[1.0], [2e-12]];
        let rates = PerGroup { opacity_logit: 0.05, ..PerGroup::default() };
        SplatAdam::new(&g).step(&mut g, &gradient, &rates);
        assert!(g.opacity_logit.iter().all(|l| (l[0] + 0.05).abs() < 1e-4), "{:?}", g.opacity_logit);
    }

    #[test]
    fn splats_that_a_view_does_not_show_wait_but_for_their_opacities() {
        let mut g = Splats::zeros(5);
        g.f_rest.resize(5, [0.0; 45]);
        let start = g.clone();
        let mut gradient =
            SeenGradient { indices: vec![1, 2, 4], by_opacity: 1e-9, ..SeenGradient::default() };
        gradient.of_seen.take_from(&g, &gradient.indices);
        gradient.of_seen.f_rest.fill([2.0; 45]);
        gradient.of_seen.position.fill([-3.0, 0.0, 1.0]);
        gradient.of_seen.opacity_logit.fill([-2.0]);
        let rates =
            PerGroup { f_rest: 0.1, position: 0.2, opacity_logit: 0.3, rotation: 0.4, ..PerGroup::default() };
        let mut adam = SplatAdam::new(&g);
        adam.step_seen(&mut g, &gradient, &rates);
        for i in 0..5 {
            let is_seen = gradient.indices.contains(&(i as u32));
            let expected = if is_seen { (-0.1, 0.2, 0.3) } else { (0.0, 0.0, -0.3) };
            let found = (g.f_rest[i][44], g.position[i][0], g.opacity_logit[i][0]);
            let differs = |a: f32, b: f32| (a - b).abs() > 1e-5;
            assert!(
                !differs(found.0, expected.0)
                    && !differs(found.1, expected.1)
                    && !differs(found.2, expected.2),
                "{i}: {found:?}"
            );
        }
        let before = (g.clone(), adam.first.clone());
        gradient.indices = vec![2, 3, 4];
        adam.step_seen(&mut g, &gradient, &rates);
        assert!(g.position[1] == before.0.position[1] && adam.first.f_rest[1] == before.1.f_rest[1]);
        assert!(g.position[3] != start.position[3] && g.position[0] == start.position[0]);
    }

    #[test]
    fn a_view_that_shows_all_splats_steps_as_one_without_selection() {
        let mut splats = Splats::default();
        for i in 0..9000 {
            splats.push([i as f32, 0.5, -1.0], 0.3, 0.4, [0.1, 0.2, 0.3]);
        }
        let of_seen = splats.clone();
        let rates =
            PerGroup { position: 0.1, f_dc: 0.2, opacity_logit: 0.3, log_scale: 0.4, ..PerGroup::default() };
        let (mut all, mut seen) = (splats.clone(), splats);
        let (mut adam, mut adam_seen) = (SplatAdam::new(&all), SplatAdam::new(&all));
        adam.step(&mut all, &of_seen, &rates);
        let gradient = SeenGradient { indices: (0..9000).collect(), of_seen, by_opacity: 5.0 };
        adam_seen.step_seen(&mut seen, &gradient, &rates);
        assert!(all == seen && adam == adam_seen);
    }
}
