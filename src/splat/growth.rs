//! Active growth (IndoorSplat §4.2): splats that have grown grow faster for as long as the images ask for more.
//!
//! At each check, a splat whose mean gradient `g` by the 2-D mean reaches the rule's value is duplicated or split in two, as in
//! 3DGS, if it is not active; it and the new ones then are. An active one is replaced by four parts of half its scale, so that
//! discs keep their area, at positions drawn from its own distribution; the parts are active. A splat whose `g` stays below in
//! several checks is active no longer. Where the number of splats is limited, active ones come first, and those of greater `g`
//! before others.

use crate::splat::densify::{DensifyEdit, DensifyStats, Selection, SplitInto};
use crate::splat::edit::Edit;
use crate::splat::recipe::{ActiveGrowth, Densification};
use crate::splat::splats::Splats;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// What replaces an active splat.
const OF_ACTIVE: SplitInto = SplitInto { parts: 4, shrinks: 2.0, draw: 30 };

/// Which splats are active.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ActiveSplats {
    /// For each splat, the number of checks without growth after which it is active no longer; 0 if it is not active.
    rounds: Vec<u8>,
}

impl ActiveSplats {
    /// Of `n` splats none is active.
    #[must_use]
    pub fn none(n: usize) -> Self {
        Self { rounds: vec![0; n] }
    }

    /// Number of splats, active or not.
    #[must_use]
    pub fn splats(&self) -> usize {
        self.rounds.len()
    }

    /// Number of active splats.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rounds.iter().filter(|rounds| **rounds > 0).count()
    }

    /// Applies an edit of the splats; new splats are not active.
    pub fn apply(&mut self, edit: &Edit) {
        edit.gather(&mut self.rounds);
        self.rounds[edit.fresh()].fill(0);
    }

    /// Makes these splats active.
    pub fn activate(&mut self, splats: Range<usize>, growth: ActiveGrowth) {
        self.rounds[splats].fill(growth.idle_rounds);
    }

    /// Plans a densification by the rule with active growth, as [`DensifyEdit::plan`] does by the rule alone, and ends the
    /// activity of splats that did not grow. The new splats still have to be made active.
    #[must_use]
    pub fn plan(
        &mut self,
        splats: &Splats,
        statistics: &DensifyStats,
        (rule, growth): (&Densification, ActiveGrowth),
        half_side_m: f64,
        draw: (u64, u64),
    ) -> DensifyEdit {
        let mut asked = Vec::new();
        for (i, rounds) in self.rounds.iter_mut().enumerate() {
            let gradient = statistics.mean_gradient(i);
            if gradient >= rule.gradient as f32 {
                asked.push((*rounds > 0, gradient, i));
            } else {
                *rounds = rounds.saturating_sub(1);
            }
        }
        // The sort is stable: equal ones keep the order of their indices.
        asked.sort_by(|a, b| b.0.cmp(&a.0).then(b.1.total_cmp(&a.1)));
        let mut selection = Selection::new(splats.len(), draw);
        for (is_active, _, i) in asked {
            let added = if is_active { OF_ACTIVE.parts - 1 } else { 1 };
            if selection.splats() + added > rule.max_splats as usize {
                break;
            }
            if is_active {
                selection.split(i, OF_ACTIVE);
            } else {
                selection.duplicate_or_split(splats, i, rule.copy_below * half_side_m);
                self.activate(i..i + 1, growth);
            }
        }
        selection.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::splats::{PerGroup, sigmoid};
    use crate::splat::state::TrainingState;

    const GROWTH: ActiveGrowth = ActiveGrowth { idle_rounds: 2 };

    fn rule(max_splats: u32) -> Densification {
        Densification {
            from: 0,
            until: 1000,
            max_scale: None,
            max_radius: None,
            gradient: 2e-4,
            copy_below: 0.01,
            max_splats,
            active: Some(GROWTH),
        }
    }

    /// Discs in a row, of which the second is large.
    fn state() -> TrainingState {
        let mut splats = Splats::default();
        for (x, scale) in [(0.0, 0.3), (1.0, 4.0), (2.0, 0.3)] {
            splats.push([x, 0.0, -x], scale, 0.7, [0.5; 3]);
        }
        splats.flatten();
        let mut state = TrainingState::start(splats, Default::default(), 0, 0);
        state.adam.first.position = vec![[1.0; 3]; 3];
        state
    }

    /// One check with these mean gradients of the splats; returns how many grew.
    fn check(state: &mut TrainingState, gradients: &[f32], iteration: u64, max_splats: u32) -> usize {
        state.statistics.reset(state.splats.len());
        state.statistics.add_view(|i| Some([gradients[i], 0.0]), 0.0, 1.0);
        state.densify(&rule(max_splats), 100.0, (7, iteration))
    }

    #[test]
    fn growing_splats_and_their_copies_become_active_and_the_others_do_not() {
        let mut state = state();
        assert_eq!(state.active.count(), 0);
        assert_eq!(check(&mut state, &[2e-4, 1.0, 1e-4], 100, 100), 2);
        // The duplicated one, the idle one, the parts of the large one, whose gradient is greater, and the duplicate.
        let sizes: Vec<f32> = state.splats.log_scale.iter().map(|s| s[0].exp()).collect();
        for (size, expected) in sizes.iter().zip([0.3, 0.3, 2.5, 2.5, 0.3]) {
            assert!((size - expected).abs() < 1e-5, "{sizes:?}");
        }
        assert_eq!(state.active.rounds, [2, 0, 2, 2, 2]);
    }

    #[test]
    fn an_active_splat_is_replaced_by_four_parts_of_half_its_scale_and_equal_opacity() {
        let mut state = state();
        state.active.activate(1..2, GROWTH);
        assert_eq!(check(&mut state, &[0.0, 1.0, 0.0], 100, 100), 1);
        assert_eq!((state.splats.len(), &state.active.rounds[..]), (6, &[0, 0, 2, 2, 2, 2][..]));
        let parts = &state.splats.position[2..];
        for (k, part) in parts.iter().enumerate() {
            assert!((state.splats.log_scale[2 + k][0].exp() - 2.0).abs() < 1e-5);
            assert!((sigmoid(state.splats.opacity_logit[2 + k][0]) - 0.7).abs() < 1e-6);
            // They lie in the plane of the disc, whose normal is vertical, each elsewhere.
            assert!((part[2] + 1.0).abs() < 1e-4, "{part:?}");
            assert!(parts[..k].iter().all(|other| other != part));
            assert_eq!(state.adam.first.position[2 + k], [0.0; 3]);
        }
        assert_eq!(state.adam.first.position[0], [1.0; 3]);
    }

    #[test]
    fn parts_that_no_view_has_shown_keep_their_opacity() {
        let mut state = state();
        let rates = PerGroup { opacity_logit: 0.05, ..PerGroup::default() };
        let mut gradient = Splats::zeros(3);
        gradient.resize_like(&state.splats);
        gradient.opacity_logit.fill([1e-5]);
        (0..50).for_each(|_| state.adam.step(&mut state.splats, &gradient, &rates));
        state.splats.opacity_logit.fill([0.7]);
        state.active.activate(1..2, GROWTH);
        check(&mut state, &[0.0, 1.0, 0.0], 100, 100);
        // The sum of opacities alone.
        let mut gradient = Splats::zeros(6);
        gradient.resize_like(&state.splats);
        gradient.opacity_logit.fill([1e-10]);
        let before = state.splats.opacity_logit[2..].to_vec();
        (0..40).for_each(|_| state.adam.step(&mut state.splats, &gradient, &rates));
        let lost = before.iter().zip(&state.splats.opacity_logit[2..]).map(|(a, b)| a[0] - b[0]);
        assert!(lost.clone().all(|lost| lost.abs() < 0.01), "{:?}", lost.collect::<Vec<_>>());
    }

    #[test]
    fn a_splat_that_does_not_grow_for_some_checks_is_active_no_longer() {
        let mut state = state();
        state.active.activate(0..1, GROWTH);
        check(&mut state, &[1e-4; 3], 100, 100);
        assert_eq!(state.active.count(), 1);
        check(&mut state, &[1e-4; 3], 200, 100);
        assert_eq!((state.active.count(), state.splats.len()), (0, 3));
    }

    #[test]
    fn within_a_limit_active_splats_come_first_and_then_those_of_greater_gradient() {
        let mut active_first = state();
        active_first.active.activate(2..3, GROWTH);
        assert_eq!(check(&mut active_first, &[0.5, 1.0, 1e-3], 100, 6), 1);
        assert_eq!(active_first.active.rounds, [0, 0, 2, 2, 2, 2]);
        let mut greatest = state();
        assert_eq!(check(&mut greatest, &[0.5, 1.0, 0.7], 100, 5), 2);
        assert_eq!(greatest.active.rounds, [0, 2, 2, 2, 2]);
        assert_eq!(check(&mut greatest, &[1.0; 5], 200, 7), 0, "there is no room for three more");
    }

    #[test]
    fn positions_of_parts_depend_on_seed_iteration_and_splat_only() {
        let grown = |iteration| {
            let mut state = state();
            state.active.activate(1..2, GROWTH);
            check(&mut state, &[0.0, 1.0, 0.0], iteration, 100);
            state.splats.position
        };
        assert_eq!(grown(100), grown(100));
        assert_ne!(grown(100), grown(200));
    }

    #[test]
    fn activity_follows_the_splats_when_others_are_removed() {
        let mut state = state();
        state.active.activate(2..3, GROWTH);
        state.splats.opacity_logit[0] = [-9.0];
        assert_eq!(state.prune(0.05, f64::INFINITY, (f64::MIN, f64::MAX)), 1);
        assert_eq!(state.active.rounds, [0, 2]);
        assert!(state.fits(0));
        state.active.rounds.pop();
        assert!(!state.fits(0));
    }
}
