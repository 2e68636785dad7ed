//! Anchored splats (GeoProp-GS §3.3, AGO): their parameters are those of another splat, the anchor, plus a residual.
//!
//! `theta = theta_anchor + residual` for all parameters as they are optimised: position, coefficients of colour, logit of the
//! opacity, logarithm of the scale, quaternion. The residual is what is optimised. An anchored splat without a gradient of its own, as one
//! that no image shows, keeps its residual and goes wherever its anchor goes; the anchor gets the gradients of all that are anchored to
//! it.
//!
//! [`Splats`] always hold the composed parameters, so that rendering knows nothing of anchors.

use super::edit::Edit;
use super::splats::{GROUP_INFO, Splats};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// A splat and the one that it is anchored to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Anchoring {
    /// Index of the anchored splat.
    pub splat: u32,
    /// Index of its anchor, which is not anchored itself.
    pub anchor: u32,
}

/// Splats that training starts from, and which of them are anchored.
#[derive(Clone, Debug, Default)]
pub struct StartSplats {
    /// The splats.
    pub splats: Splats,
    /// The anchored ones, by rising index.
    pub anchorings: Vec<Anchoring>,
}

impl From<Splats> for StartSplats {
    fn from(splats: Splats) -> Self {
        Self { splats, anchorings: Vec::new() }
    }
}

/// For each position the index of the nearest anchor; none without anchors, or where positions cannot be searched.
#[must_use]
pub fn nearest_anchors(anchors: &[[f64; 3]], positions: &[[f64; 3]]) -> Option<Vec<usize>> {
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(anchors).ok().filter(|_| !anchors.is_empty())?;
    let nearest =
        |at: &[f64; 3]| tree.query(at).nearest_one::<SquaredEuclidean<f64>>().execute().item as usize;
    Some(positions.par_iter().map(nearest).collect())
}

/// The anchored splats among splats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct AnchoredSplats {
    anchorings: Vec<Anchoring>,
    /// The residuals, in the order of `anchorings`.
    residuals: Splats,
}

/// A parameter group of all splats, that of the residuals, and the number of values of a splat.
type Group<'a> = ((&'a mut [f32], &'a mut [f32]), usize);

impl AnchoredSplats {
    /// Anchors splats to others as they are now. The quaternion of an anchored splat is turned to the side of its anchor's.
    #[must_use]
    pub fn new(splats: &mut Splats, anchorings: Vec<Anchoring>) -> Self {
        for Anchoring { splat, anchor } in &anchorings {
            let of_anchor = splats.rotation[*anchor as usize];
            let rotation = &mut splats.rotation[*splat as usize];
            if rotation.iter().zip(of_anchor).map(|(a, b)| a * b).sum::<f32>() < 0.0 {
                *rotation = rotation.map(|v| -v);
            }
        }
        let mut out = Self { anchorings, residuals: Splats::default() };
        out.refresh(splats);
        out
    }

    /// Recomputes the residuals after parameters were set.
    pub fn refresh(&mut self, splats: &Splats) {
        let indices = |of: fn(&Anchoring) -> u32| -> Vec<u32> { self.anchorings.iter().map(of).collect() };
        let mut anchors = Splats::default();
        anchors.take_from(splats, &indices(|a| a.anchor));
        self.residuals.take_from(splats, &indices(|a| a.splat));
        for (residual, anchor) in self.residuals.groups_mut().into_iter().zip(anchors.groups()) {
            residual.iter_mut().zip(anchor).for_each(|(r, a)| *r -= a);
        }
    }

    /// The anchorings, by rising index of the anchored splat.
    #[must_use]
    pub fn anchorings(&self) -> &[Anchoring] {
        &self.anchorings
    }

    /// Adds the gradients of anchored splats to those of their anchors.
    pub fn add_to_anchors(&self, gradient: &mut Splats) {
        if self.anchorings.is_empty() {
            return;
        }
        gradient.groups_mut().into_par_iter().zip(GROUP_INFO).for_each(|(values, info)| {
            if values.is_empty() {
                return;
            }
            for Anchoring { splat, anchor } in &self.anchorings {
                let (from, to) = (*splat as usize * info.width, *anchor as usize * info.width);
                for k in 0..info.width {
                    values[to + k] += values[from + k];
                }
            }
        });
    }

    /// Calls `optimise` with splats that hold the residuals in place of the anchored splats' parameters, and composes again.
    pub fn step(&mut self, splats: &mut Splats, optimise: impl FnOnce(&mut Splats)) {
        self.for_groups(splats, |anchorings, ((values, residuals), width)| {
            for (Anchoring { splat, .. }, residual) in anchorings.iter().zip(residuals.chunks_exact(width)) {
                values[*splat as usize * width..][..width].copy_from_slice(residual);
            }
        });
        optimise(splats);
        self.for_groups(splats, |anchorings, ((values, residuals), width)| {
            let rows = anchorings.iter().zip(residuals.chunks_exact_mut(width));
            for (Anchoring { splat, anchor }, residual) in rows {
                let (own, of_anchor) = (*splat as usize * width, *anchor as usize * width);
                residual.copy_from_slice(&values[own..own + width]);
                for k in 0..width {
                    values[own + k] += values[of_anchor + k];
                }
            }
        });
    }

    /// The residuals, in the order of the anchorings.
    #[must_use]
    pub fn residuals(&self) -> &Splats {
        &self.residuals
    }

    /// Replaces the residuals, which are in the order of the anchorings.
    pub fn set_residuals(&mut self, residuals: Splats) {
        self.residuals = residuals;
    }

    fn for_groups(&mut self, splats: &mut Splats, each: impl Fn(&[Anchoring], Group) + Sync) {
        let Self { anchorings, residuals } = self;
        if anchorings.is_empty() {
            return;
        }
        let groups = splats.groups_mut().into_par_iter().zip(residuals.groups_mut()).zip(GROUP_INFO);
        groups
            .filter(|((values, _), _)| !values.is_empty())
            .for_each(|(group, info)| each(anchorings, (group, info.width)));
    }

    /// Follows an edit of the splats. Copies of anchored splats are free, as are splats whose anchor is gone.
    pub fn apply(&mut self, edit: &Edit, before: usize) {
        if self.anchorings.is_empty() {
            return;
        }
        const GONE: u32 = u32::MAX;
        let mut now = vec![GONE; before];
        for (new, old) in edit.source[..edit.fresh_from].iter().enumerate() {
            if now[*old as usize] == GONE {
                now[*old as usize] = new as u32;
            }
        }
        let kept = self.anchorings.iter().enumerate().filter_map(|(k, a)| {
            let (splat, anchor) = (now[a.splat as usize], now[a.anchor as usize]);
            (splat != GONE && anchor != GONE).then_some((Anchoring { splat, anchor }, k as u32))
        });
        let mut kept: Vec<(Anchoring, u32)> = kept.collect();
        kept.sort_by_key(|(a, _)| a.splat);
        self.anchorings = kept.iter().map(|k| k.0).collect();
        self.residuals.apply(&Edit::permute(kept.iter().map(|k| k.1).collect()));
    }

    /// Whether residuals and anchorings fit each other and this number of splats.
    #[must_use]
    pub fn fits(&self, splats: usize) -> bool {
        self.residuals.is_whole(self.anchorings.len())
            && self.anchorings.iter().all(|a| (a.splat as usize) < splats && (a.anchor as usize) < splats)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::adam::SplatAdam;
    use crate::splat::splats::PerGroup;

    fn three() -> (Splats, AnchoredSplats) {
        let mut splats = Splats::default();
        for (i, x) in [0.0, 1.0, 5.0].into_iter().enumerate() {
            splats.push([x, 0.1 * x, -x], 0.3 + 0.1 * i as f32, 0.2, [0.1 * i as f32; 3]);
        }
        splats.rotation[2] = [-0.9, 0.1, 0.2, 0.3];
        let anchored = AnchoredSplats::new(&mut splats, vec![Anchoring { splat: 2, anchor: 0 }]);
        (splats, anchored)
    }

    fn rates() -> PerGroup<f64> {
        PerGroup {
            position: 0.01,
            f_dc: 0.02,
            opacity_logit: 0.03,
            log_scale: 0.04,
            rotation: 0.05,
            ..PerGroup::default()
        }
    }

    fn step(splats: &mut Splats, anchored: &mut AnchoredSplats, adam: &mut SplatAdam, mut gradient: Splats) {
        anchored.add_to_anchors(&mut gradient);
        anchored.step(splats, |splats| adam.step(splats, &gradient, &rates()));
    }

    #[test]
    fn a_splat_that_no_image_shows_follows_its_anchor_with_the_same_residual() {
        let (mut splats, mut anchored) = three();
        let residuals = anchored.residuals.clone();
        let mut adam = SplatAdam::new(&splats);
        for k in 0..20 {
            let mut gradient = Splats::zeros(3);
            gradient.groups_mut().into_iter().zip(GROUP_INFO).for_each(|(values, info)| {
                if !values.is_empty() {
                    values[..2 * info.width].iter_mut().for_each(|v| *v = 1.0 - 0.2 * k as f32);
                }
            });
            step(&mut splats, &mut anchored, &mut adam, gradient);
        }
        assert_eq!(anchored.residuals, residuals);
        assert!(splats.position[0] != [0.0; 3]);
        for k in 0..3 {
            assert!(splats.position[2][k] == splats.position[0][k] + residuals.position[0][k]);
        }
        assert!(splats.rotation[2][0] > 0.0, "the quaternion is on the side of the anchor's");
    }

    #[test]
    fn gradients_of_anchored_splats_reach_their_anchors() {
        // The sum of all parameters of the composed splats, by central differences of free parameters and residuals.
        let (mut splats, mut anchored) = three();
        let value = |splats: &Splats| -> f64 {
            splats
                .position
                .iter()
                .enumerate()
                .map(|(i, p)| (i as f64 + 1.0) * f64::from(p[0]) * f64::from(p[1]))
                .sum()
        };
        let mut gradient = Splats::zeros(3);
        for i in 0..3 {
            let weight = i as f32 + 1.0;
            gradient.position[i] = [weight * splats.position[i][1], weight * splats.position[i][0], 0.0];
        }
        anchored.add_to_anchors(&mut gradient);
        for (i, k) in [(0, 0), (0, 1), (1, 0), (2, 0), (2, 1)] {
            let moved = |by: f32| {
                let (mut splats, mut anchored) = (splats.clone(), anchored.clone());
                anchored.step(&mut splats, |s| s.position[i][k] += by);
                value(&splats)
            };
            let found = (moved(0.25) - moved(-0.25)) / 0.5;
            assert!((found - f64::from(gradient.position[i][k])).abs() < 1e-6, "{i} {k}: {found}");
        }
        // Composing again without a step changes nothing.
        let before = splats.clone();
        anchored.step(&mut splats, |_| {});
        assert_eq!(splats, before);
    }

    #[test]
    fn parameters_that_were_set_stay_after_a_refresh() {
        let (mut splats, mut anchored) = three();
        splats.opacity_logit.fill([-5.0]);
        anchored.refresh(&splats);
        anchored.step(&mut splats, |_| {});
        assert!(splats.opacity_logit.iter().all(|l| *l == [-5.0]), "{:?}", splats.opacity_logit);
    }

    #[test]
    fn anchors_are_followed_through_sorting_and_those_without_one_are_free() {
        let (mut splats, mut anchored) = three();
        let edit = Edit::permute(vec![2, 1, 0]);
        splats.apply(&edit);
        anchored.apply(&edit, 3);
        assert_eq!(anchored.anchorings(), [Anchoring { splat: 0, anchor: 2 }]);
        assert!(anchored.fits(3) && !anchored.fits(2));
        let before = splats.clone();
        anchored.step(&mut splats, |_| {});
        assert_eq!(splats, before);
        anchored.apply(&Edit::retain(&[true, true, false]), 3);
        assert!(anchored.anchorings().is_empty() && anchored.fits(2));
    }
}
