//! The state of a training between two iterations: what a checkpoint holds.

use super::adam::{AppearanceAdam, SplatAdam};
use super::appearance::{Appearance, AppearanceKind};
use super::densify::{DensifyStats, Growth, pruning};
use super::edit::Edit;
use super::splats::{Splats, logit};
use super::train::recipe::Densification;
use serde::{Deserialize, Serialize};

/// Splats, their optimiser's moments, the views' colour models, and the statistics that growth asks for.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingState {
    /// The splats.
    pub splats: Splats,
    /// Their moments.
    pub adam: SplatAdam,
    /// The colour model of every view, and its moments.
    pub appearances: Vec<(Appearance, AppearanceAdam)>,
    /// What the views said of the splats since the last check of their number.
    pub statistics: DensifyStats,
}

impl TrainingState {
    /// The start of a training from these splats, for a number of views with a colour model.
    #[must_use]
    pub fn start(splats: Splats, appearance: AppearanceKind, views: usize) -> Self {
        let mut statistics = DensifyStats::default();
        statistics.reset(splats.len());
        let adam = SplatAdam::new(splats.len());
        let appearances = vec![(Appearance::start(appearance), AppearanceAdam::default()); views];
        let mut start = Self { splats, adam, appearances, statistics };
        start.sort_by_altitude();
        start
    }

    /// Applies an edit to everything that holds a value for each splat.
    pub fn apply(&mut self, edit: &Edit) {
        self.splats.apply(edit);
        self.adam.apply(edit);
        self.statistics.apply(edit);
    }

    /// Stores splats from the highest to the lowest, so that cameras read memory in the order in which they draw.
    pub fn sort_by_altitude(&mut self) {
        let mut order: Vec<u32> = (0..self.splats.len() as u32).collect();
        let altitude = |i: u32| self.splats.position[i as usize][2];
        order.sort_by(|a, b| altitude(*b).total_cmp(&altitude(*a)));
        self.apply(&Edit::permute(order));
    }

    /// Doubles splats by a rule in a site whose cube has this half side; `draw` is (seed, iteration). Gives how many.
    pub fn grow(&mut self, rule: &Densification, half_side_m: f64, draw: (u64, u64)) -> usize {
        let growth = Growth::plan(&self.splats, &self.statistics, rule, half_side_m, draw);
        let count = growth.count;
        self.apply(&growth.edit);
        growth.shrink_parts(&mut self.splats);
        count
    }

    /// Removes splats that are fainter than `opacity`, not finite, or outside `altitudes` (metres). Gives how many.
    pub fn prune(&mut self, opacity: f64, altitudes: (f64, f64)) -> usize {
        let before = self.splats.len();
        self.apply(&pruning(&self.splats, opacity, altitudes));
        before - self.splats.len()
    }

    /// Lowers every opacity to at most `opacity` and forgets the moments of the opacities.
    pub fn reset_opacity(&mut self, opacity: f64) {
        let highest = logit(opacity as f32);
        for [logit] in &mut self.splats.opacity_logit {
            *logit = logit.min(highest);
        }
        self.adam.first.opacity_logit.fill([0.0]);
        self.adam.second.opacity_logit.fill([0.0]);
    }

    /// Whether its parts are of as many splats, and of so many views.
    #[must_use]
    pub fn fits(&self, views: usize) -> bool {
        let n = self.splats.len();
        let parts = [&self.splats, &self.adam.first, &self.adam.second];
        parts.into_iter().all(|part| part.is_whole(n))
            && self.statistics.splats() == n
            && self.appearances.len() == views
    }
}
