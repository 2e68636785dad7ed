//! The state of a training between two iterations, which checkpoints store.

use super::adam::SplatAdam;
use super::anchored::{AnchoredSplats, StartSplats};
use super::appearance::satgs::{NetworkGroup, Networks};
use super::appearance::{Appearance, AppearanceKind};
use super::densify::{DensifyEdit, DensifyStats, pruning};
use super::edit::Edit;
use super::growth::ActiveSplats;
use super::recipe::{Densification, NetworkRates};
use super::splats::{Splats, logit};
use super::visibility::VisibilityState;
use crate::nn::adam::Adam;
use serde::{Deserialize, Serialize};

/// Parameters of a colour model that all views share.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SharedParameters {
    /// The parameters.
    pub values: Vec<f32>,
    /// The moments of the gradient of each group of networks.
    pub moments: Vec<Adam>,
}

impl SharedParameters {
    /// Takes one step with these learning rates.
    pub fn step(&mut self, gradient: &[f32], rates: &NetworkRates) {
        if self.values.is_empty() {
            return;
        }
        let groups = Networks::default().groups();
        self.moments.resize_with(groups.len(), Adam::default);
        let rates = [rates.tables, rates.tone, rates.shadow];
        for ((NetworkGroup { range, rule }, moments), rate) in
            groups.into_iter().zip(&mut self.moments).zip(rates)
        {
            moments.step(rule, &mut self.values[range.clone()], &gradient[range], rate);
        }
    }
}

/// Splats, optimiser moments, the views' colour models, and the statistics for densification.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingState {
    /// The splats.
    pub splats: Splats,
    /// Moments of the splats' gradients.
    pub adam: SplatAdam,
    /// The colour model of each view, and the moments of its gradient.
    pub appearances: Vec<(Appearance, Adam)>,
    /// Parameters of the colour model that all views share.
    pub shared: SharedParameters,
    /// Visibility of the views' pixels.
    pub visibility: VisibilityState,
    /// Statistics of the splats' gradients since the last check.
    pub statistics: DensifyStats,
    /// Which splats are active, for active growth.
    pub active: ActiveSplats,
    /// Splats that are anchored to others.
    pub anchored: AnchoredSplats,
}

impl TrainingState {
    /// The initial state of a training from these splats, for a number of views with this colour model, whose networks start
    /// at random.
    #[must_use]
    pub fn start(start: impl Into<StartSplats>, appearance: AppearanceKind, views: usize, seed: u64) -> Self {
        let StartSplats { mut splats, anchorings } = start.into();
        let anchored = AnchoredSplats::new(&mut splats, anchorings);
        let mut statistics = DensifyStats::default();
        statistics.reset(splats.len());
        let adam = SplatAdam::new(&splats);
        let of_view = |view| (Appearance::start(appearance, seed, view), Adam::default());
        let appearances = (0..views as u64).map(of_view).collect();
        let shared = SharedParameters { values: appearance.start_shared(seed), moments: Vec::new() };
        let visibility = VisibilityState::default();
        let active = ActiveSplats::none(splats.len());
        let mut start = Self { splats, adam, appearances, shared, visibility, statistics, active, anchored };
        start.sort_by_altitude();
        start
    }

    /// Applies an edit to all values that belong to splats.
    pub fn apply(&mut self, edit: &Edit) {
        self.anchored.apply(edit, self.splats.len());
        self.splats.apply(edit);
        self.adam.apply(edit);
        self.statistics.apply(edit);
        self.active.apply(edit);
    }

    /// Stores the splats from the highest to the lowest, so that rendering reads memory in order.
    pub fn sort_by_altitude(&mut self) {
        let mut order: Vec<u32> = (0..self.splats.len() as u32).collect();
        let altitude = |i: u32| self.splats.position[i as usize][2];
        order.sort_by(|a, b| altitude(*b).total_cmp(&altitude(*a)));
        self.apply(&Edit::permute(order));
    }

    /// Densifies: duplicates or splits splats. Returns how many. `half_side_m` is the half side in metres of the cube that
    /// the rule's lengths refer to; `draw` is (seed, iteration) of the random positions.
    pub fn densify(&mut self, rule: &Densification, half_side_m: f64, draw: (u64, u64)) -> usize {
        let Self { splats, statistics, active, .. } = self;
        let densification = match rule.active {
            Some(growth) => active.plan(splats, statistics, (rule, growth), half_side_m, draw),
            None => DensifyEdit::plan(splats, statistics, rule, half_side_m, draw),
        };
        let count = densification.count;
        let of_opacities = rule.active.map(|_| self.adam.second.opacity_logit.clone());
        self.apply(&densification.edit);
        if let (Some(growth), Some(before)) = (rule.active, of_opacities) {
            self.active.activate(densification.edit.fresh(), growth);
            self.adam.keep_size_of_opacity_gradients(&densification.edit, &before);
        }
        densification.shrink_parts(&mut self.splats);
        count
    }

    /// Removes splats whose opacity is below `opacity`, whose largest scale exceeds `largest_m`, whose position or scale is
    /// not finite, or that lie outside `altitudes` (lowest and highest, metres). Returns how many.
    pub fn prune(&mut self, opacity: f64, largest_m: f64, altitudes: (f64, f64)) -> usize {
        let before = self.splats.len();
        self.apply(&pruning(&self.splats, opacity, largest_m, altitudes));
        before - self.splats.len()
    }

    /// Opacity reset: lowers every opacity to at most `opacity` and sets the moments of the opacities to zero.
    pub fn reset_opacity(&mut self, opacity: f64) {
        let highest = logit(opacity as f32);
        for [logit] in &mut self.splats.opacity_logit {
            *logit = logit.min(highest);
        }
        self.anchored.refresh(&self.splats);
        self.adam.first.opacity_logit.fill([0.0]);
        self.adam.second.opacity_logit.fill([0.0]);
    }

    /// Whether all parts have the same number of splats, and the state has this number of views.
    #[must_use]
    pub fn fits(&self, views: usize) -> bool {
        let n = self.splats.len();
        let parts = [&self.splats, &self.adam.first, &self.adam.second];
        parts.into_iter().all(|part| part.is_whole(n) && part.is_like(&self.splats))
            && self.statistics.splats() == n
            && self.active.splats() == n
            && self.anchored.fits(n)
            && self.appearances.len() == views
    }
}
