//! Where iterations run. `train` plans and decides; a backend owns the splats between steps.

pub mod checkpoint;
pub mod cpu;
pub mod stopwatch;

use crate::splat::adam::{AppearanceAdam, SplatAdam};
use crate::splat::appearance::Appearance;
use crate::splat::densify::{Change, DensifyStats};
use crate::splat::objective::{LossWeights, Losses};
use crate::splat::splats::Splats;
use crate::splat::train::recipe::Densification;
use serde::{Deserialize, Serialize};

/// Everything one iteration does.
#[derive(Clone, Debug)]
pub struct StepPlan {
    /// Iteration, from 1.
    pub iteration: u32,
    /// Index of the training view.
    pub view: usize,
    /// Resolution: 0 full, 1 half.
    pub level: usize,
    /// Whether sunlight is modelled, where the view has a sun.
    pub shadows: bool,
    /// The virtual camera's shear, half image sides per metre.
    pub virtual_shear: Option<[f64; 2]>,
    /// Colour behind the splats.
    pub background: [f32; 3],
    /// What the loss weighs.
    pub weights: LossWeights,
    /// Adam's rates: position (metres), log scale, rotation, logit, colour, radiometry.
    pub rates: [f64; 6],
    /// What is done to the population after the step.
    pub population: DensifyPlan,
}

/// Changes to the splats' number and opacity after a step.
#[derive(Clone, Debug, Default)]
pub struct DensifyPlan {
    /// Double the splats that ask for it, in a cube of this half side, metres.
    pub grow: Option<(Densification, f64)>,
    /// Remove splats fainter than this.
    pub prune_below: Option<f64>,
    /// Lower opacities to this.
    pub reset_opacity: Option<f64>,
    /// Seed of the draws for split splats.
    pub seed: u64,
}

/// What a step reports.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    /// The loss and its terms.
    pub losses: Losses,
    /// Splats after the step.
    pub splats: usize,
    /// What growth and pruning did.
    pub change: Change,
}

/// What training has made, with all that it takes to go on.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// The splats.
    pub splats: Splats,
    /// Their moments.
    pub adam: SplatAdam,
    /// Radiometry of every view, and its moments.
    pub appearances: Vec<(Appearance, AppearanceAdam)>,
    /// What views said of the splats since the last check of their number.
    pub statistics: DensifyStats,
}

impl Snapshot {
    /// Training's start from these splats, for a number of views.
    #[must_use]
    pub fn start(splats: Splats, views: usize) -> Self {
        let mut statistics = DensifyStats::default();
        statistics.reset(splats.len());
        let adam = SplatAdam::new(splats.len());
        let mut start = Self { splats, adam, appearances: vec![Default::default(); views], statistics };
        start.sort_by_altitude();
        start
    }

    /// Stores splats from the highest to the lowest: memory is then read about in the order that cameras draw in.
    ///
    /// The statistics must have been reset.
    pub fn sort_by_altitude(&mut self) {
        let mut order: Vec<u32> = (0..self.splats.len() as u32).collect();
        let altitude = |i: u32| self.splats.position[i as usize][2];
        order.sort_by(|a, b| altitude(*b).total_cmp(&altitude(*a)));
        for part in [&mut self.splats, &mut self.adam.first, &mut self.adam.second] {
            part.permute(&order);
        }
    }

    /// Whether its parts are of as many splats, and of so many views.
    #[must_use]
    pub fn fits(&self, views: usize) -> bool {
        let n = self.splats.len();
        let full = |g: &Splats| {
            [g.position.len(), g.log_scale.len(), g.rotation.len(), g.f_dc.len()].iter().all(|l| *l == n)
        };
        let parts = [&self.splats, &self.adam.first, &self.adam.second];
        parts.into_iter().all(|g| g.len() == n && full(g))
            && self.statistics.splats() == n
            && self.appearances.len() == views
    }
}

/// Runs whole iterations on some hardware.
pub trait TrainingBackend {
    /// Runs one iteration.
    fn step(&mut self, plan: &StepPlan) -> StepReport;
    /// What training has made so far.
    fn snapshot(&mut self) -> &Snapshot;
}
