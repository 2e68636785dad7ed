//! Densification and pruning (BAEOGS §3.3): which splats are duplicated, split or removed.

use crate::random::CounterRng;
use crate::splat::edit::Edit;
use crate::splat::recipe::Densification;
use crate::splat::seen_gradient::SeenGradient;
use crate::splat::splats::{Splats, sigmoid, unit_quaternion};
use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What replaces a split splat (gsplat).
const IN_TWO: SplitInto = SplitInto { parts: 2, shrinks: 1.6, draw: 3 };
/// Number of splats whose statistics one task adds to.
const PIECE: usize = 1 << 13;
/// Number of standard deviations in a projected radius (3DGS).
const RADIUS_SIGMAS: f64 = 3.0;

/// Statistics of each splat over the training views since the last check.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DensifyStats {
    /// Sum over the views of the norm of the gradient by the 2-D mean, per half image side.
    gradient: Vec<f32>,
    /// Number of views in which the splat was visible.
    views: Vec<u32>,
    /// Largest ratio over the views of pixels per metre to pixels of the longer image side, 1/m.
    magnification: f64,
}

impl DensifyStats {
    /// Number of splats.
    #[must_use]
    pub fn splats(&self) -> usize {
        self.views.len().min(self.gradient.len())
    }

    /// Replaces the sums of each splat: of the norms of the gradient over the views, and the number of views.
    pub fn set_sums(&mut self, sums: impl Iterator<Item = (f32, u32)>) {
        (self.gradient, self.views) = sums.unzip();
    }

    /// The sums of each splat: of the norms of the gradient over the views, and the number of views.
    pub fn sums(&self) -> impl Iterator<Item = (f32, u32)> + '_ {
        self.gradient.iter().copied().zip(self.views.iter().copied())
    }

    /// Mean over the views that show a splat of the norm of the gradient by its 2-D mean, per half image side.
    #[must_use]
    pub fn mean_gradient(&self, splat: usize) -> f32 {
        self.gradient[splat] / self.views[splat].max(1) as f32
    }

    /// Applies an edit of the splats; the statistics of new splats are zero.
    pub fn apply(&mut self, edit: &Edit) {
        edit.gather(&mut self.gradient);
        edit.gather(&mut self.views);
        self.gradient[edit.fresh()].fill(0.0);
        self.views[edit.fresh()].fill(0);
    }

    /// Sets the statistics of `n` splats to zero.
    pub fn reset(&mut self, n: usize) {
        self.gradient.clear();
        self.gradient.resize(n, 0.0);
        self.views.clear();
        self.views.resize(n, 0);
        self.magnification = 0.0;
    }

    /// Adds the render of a view. `mean2d_gradient` returns the derivative of the loss by a splat's 2-D mean, per half image
    /// side, or none if the splat was not visible; `longer_side` is in pixels.
    pub fn add_view(
        &mut self,
        mean2d_gradient: impl Fn(usize) -> Option<[f32; 2]> + Sync,
        pixels_per_m: f64,
        longer_side: f64,
    ) {
        self.magnify(pixels_per_m, longer_side);
        let sums = self.gradient.par_iter_mut().zip(&mut self.views).with_min_len(1024).enumerate();
        sums.for_each(|(splat, (gradient, views))| {
            if let Some([x, y]) = mean2d_gradient(splat) {
                *gradient += length(x, y);
                *views += 1;
            }
        });
    }

    /// Adds the scale of a view; `longer_side` is in pixels.
    pub fn magnify(&mut self, pixels_per_m: f64, longer_side: f64) {
        self.magnification = self.magnification.max(pixels_per_m / longer_side);
    }

    /// Adds the render of a view that may show only the splats of its gradient. `mean2d_gradient` is as above, by the place in
    /// [`SeenGradient::indices`].
    pub fn add_seen(
        &mut self,
        gradient: &SeenGradient,
        mean2d_gradient: impl Fn(usize) -> Option<[f32; 2]> + Sync,
    ) {
        let sums = self.gradient.par_chunks_mut(PIECE).zip(self.views.par_chunks_mut(PIECE)).enumerate();
        sums.for_each(|(k, (gradients, views))| {
            let first = k * PIECE;
            for place in gradient.places(first..first + views.len()) {
                if let Some([x, y]) = mean2d_gradient(place) {
                    let i = gradient.indices[place] as usize - first;
                    gradients[i] += length(x, y);
                    views[i] += 1;
                }
            }
        });
    }
}

/// The length of a vector, without the call of the C library that [`f32::hypot`] is.
fn length(x: f32, y: f32) -> f32 {
    let (x, y) = (f64::from(x), f64::from(y));
    (x * x + y * y).sqrt() as f32
}

/// Numbers of splats that a check densified and pruned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DensifyCounts {
    /// Duplicated and split splats.
    pub densified: usize,
    /// Pruned splats.
    pub pruned: usize,
}

/// A planned densification: an edit, and which of its copies are parts of split splats.
pub struct DensifyEdit {
    /// The edit.
    pub edit: Edit,
    /// Number of splats that are duplicated or split.
    pub count: usize,
    parts: Vec<Part>,
}

/// A part of a split splat.
struct Part {
    /// Its index in the new set.
    place: usize,
    /// Its random numbers.
    draw: CounterRng,
    /// Its scales are those of the split splat divided by this.
    shrinks: f32,
}

/// How a splat is split.
#[derive(Clone, Copy)]
pub(super) struct SplitInto {
    /// Number of parts.
    pub parts: usize,
    /// The scales of the parts are divided by this.
    pub shrinks: f32,
    /// Purpose of the random numbers for the position of the first part; those of the others follow.
    pub draw: u64,
}

/// Collects the splats that a densification duplicates and splits.
pub(super) struct Selection {
    keep: Vec<bool>,
    copies: Vec<u32>,
    parts: Vec<Part>,
    count: usize,
    /// Number of splats that are split.
    split: usize,
    draw: (u64, u64),
}

impl Selection {
    /// Nothing yet of `n` splats; `draw` is (seed, iteration) of the random positions.
    pub fn new(n: usize, draw: (u64, u64)) -> Self {
        Self { keep: vec![true; n], copies: Vec::new(), parts: Vec::new(), count: 0, split: 0, draw }
    }

    /// Number of splats after the densification.
    pub fn splats(&self) -> usize {
        self.keep.len() + self.copies.len() - self.split
    }

    /// Duplicates a splat whose largest scale is below `copy_below_m`; splits another in two.
    pub fn duplicate_or_split(&mut self, splats: &Splats, splat: usize, copy_below_m: f64) {
        if f64::from(largest_scale(splats, splat)) < copy_below_m {
            self.count += 1;
            self.copies.push(splat as u32);
        } else {
            self.split(splat, IN_TWO);
        }
    }

    /// Replaces a splat by parts.
    pub fn split(&mut self, splat: usize, into: SplitInto) {
        self.count += 1;
        self.split += 1;
        self.keep[splat] = false;
        for part in 0..into.parts as u64 {
            let draw = CounterRng::new(self.draw.0, into.draw + part, self.draw.1, splat as u64);
            self.parts.push(Part { place: self.copies.len(), draw, shrinks: into.shrinks });
            self.copies.push(splat as u32);
        }
    }

    /// The densification.
    pub fn finish(mut self) -> DensifyEdit {
        let mut edit = Edit::retain(&self.keep);
        let kept = edit.fresh_from;
        self.copies.into_iter().for_each(|i| edit.push_fresh(i));
        self.parts.iter_mut().for_each(|part| part.place += kept);
        DensifyEdit { edit, count: self.count, parts: self.parts }
    }
}

/// The largest scale of a splat, metres.
fn largest_scale(splats: &Splats, splat: usize) -> f32 {
    splats.log_scale[splat].iter().fold(f32::MIN, |m, s| m.max(*s)).exp()
}

impl DensifyEdit {
    /// Plans a densification. `half_side_m` is the half side in metres of the cube that the rule's lengths refer to; `draw`
    /// is (seed, iteration) of the random positions.
    ///
    /// Small splats are duplicated; large ones are replaced by two parts. Where the rule limits the number of splats, those of
    /// the largest mean gradients come first.
    #[must_use]
    pub fn plan(
        splats: &Splats,
        statistics: &DensifyStats,
        rule: &Densification,
        half_side_m: f64,
        draw: (u64, u64),
    ) -> Self {
        let n = splats.len();
        let is_densified = |i: &usize| {
            let scale = f64::from(largest_scale(splats, *i));
            let radius = RADIUS_SIGMAS * scale * statistics.magnification;
            f64::from(statistics.mean_gradient(*i)) > rule.gradient
                || rule.max_scale.is_some_and(|most| scale > most * half_side_m)
                || rule.max_radius.is_some_and(|most| radius > most)
        };
        let mut asked: Vec<usize> = (0..n).filter(is_densified).collect();
        // Each adds one splat.
        let room = (rule.max_splats as usize).saturating_sub(n);
        if asked.len() > room {
            let gradient = |i: usize| statistics.mean_gradient(i);
            // The sort is stable: equal ones keep the order of their indices.
            asked.sort_by(|a, b| gradient(*b).total_cmp(&gradient(*a)));
            asked.truncate(room);
            asked.sort_unstable();
        }
        let mut selection = Selection::new(n, draw);
        for i in asked {
            selection.duplicate_or_split(splats, i, rule.copy_below * half_side_m);
        }
        selection.finish()
    }

    /// After the edit was applied: makes the copies of split splats smaller and moves each to a position drawn from the split
    /// splat's distribution.
    pub fn shrink_parts(self, splats: &mut Splats) {
        for Part { place: i, mut draw, shrinks } in self.parts {
            let [w, x, y, z] = unit_quaternion(splats.rotation[i]);
            let deviations = splats.log_scale[i].map(f32::exp);
            let along = Vec3::from_array(deviations.map(|deviation| draw.normal() as f32 * deviation));
            let moved = Mat3::from_quat(Quat::from_xyzw(x, y, z, w)) * along;
            splats.position[i] = (Vec3::from_array(splats.position[i]) + moved).to_array();
            splats.log_scale[i] = splats.log_scale[i].map(|s| s - shrinks.ln());
        }
    }
}

/// The edit that removes splats whose opacity is below `opacity`, whose largest scale exceeds `largest_m`, whose position or
/// scale is not finite, or that lie outside `altitudes` (lowest and highest, metres).
#[must_use]
pub fn pruning(splats: &Splats, opacity: f64, largest_m: f64, altitudes: (f64, f64)) -> Edit {
    let is_kept = |i: usize| {
        let z = f64::from(splats.position[i][2]);
        let is_finite = splats.position[i].iter().chain(&splats.log_scale[i]).all(|v| v.is_finite());
        let is_inside = z >= altitudes.0 && z <= altitudes.1;
        let is_small = splats.log_scale[i].iter().all(|s| f64::from(*s) <= largest_m.ln());
        is_finite && is_inside && is_small && f64::from(sigmoid(splats.opacity_logit[i][0])) >= opacity
    };
    Edit::retain(&(0..splats.len()).map(is_kept).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::recipe::Recipe;
    use crate::splat::state::TrainingState;

    fn state() -> TrainingState {
        let mut splats = Splats::default();
        splats.push([0.0; 3], 0.3, 0.9, [0.5; 3]);
        splats.push([1.0, 0.0, 0.0], 4.0, 0.9, [0.5; 3]);
        splats.push([2.0, 0.0, 0.0], 0.3, 0.001, [0.5; 3]);
        TrainingState::start(splats, Default::default(), 1, 0)
    }

    #[test]
    fn small_splats_are_duplicated_large_ones_split_and_transparent_ones_removed() {
        let recipe = Recipe::named("baeogs").unwrap();
        let mut state = state();
        let mean2d_gradient = |i| [Some([0.01, 0.0]), Some([0.0, 0.01]), None][i];
        state.statistics.add_view(mean2d_gradient, 0.0, 1.0);
        state.adam.first.position[0] = [1.0; 3];
        assert_eq!(state.densify(&recipe.densification.unwrap(), 226.0, (0, 100)), 2);
        // First the duplicated and the transparent splat, then the duplicate and the two parts, whose moments are zero.
        assert_eq!(state.splats.len(), 5);
        let moments: Vec<f32> = state.adam.first.position.iter().map(|m| m[0]).collect();
        assert_eq!(moments, [1.0, 0.0, 0.0, 0.0, 0.0]);
        let parts_of_split =
            state.splats.log_scale.iter().filter(|l| (l[0].exp() - 4.0 / 1.6).abs() < 1e-4).count();
        assert_eq!(parts_of_split, 2);
        assert!(state.splats.position[3] != state.splats.position[4]);
        assert_eq!(state.prune(recipe.prune_below, f64::INFINITY, (-50.0, 50.0)), 1);
        assert_eq!(state.splats.len(), 4);
    }

    #[test]
    fn where_the_number_of_splats_is_limited_the_largest_gradients_grow() {
        let rule = Recipe::named("baeogs").unwrap().densification.unwrap();
        let rule = Densification { max_splats: 4, ..rule };
        let mut state = state();
        let gradients = [0.01, 0.03, 0.02];
        state.statistics.add_view(|i| Some([gradients[i], 0.0]), 0.0, 1.0);
        // The second, which is large, is split in two.
        assert_eq!(state.densify(&rule, 226.0, (0, 100)), 1);
        assert_eq!(state.splats.len(), 4);
        assert!(state.splats.log_scale.iter().all(|scale| scale[0].exp() < 3.0));
    }

    #[test]
    fn an_opacity_reset_lowers_only_higher_opacities() {
        let mut state = state();
        state.reset_opacity(0.005);
        let o: Vec<f32> = state.splats.opacity_logit.iter().map(|l| sigmoid(l[0])).collect();
        assert!((o[0] - 0.005).abs() < 1e-6 && (o[2] - 0.001).abs() < 1e-6, "{o:?}");
    }
}
