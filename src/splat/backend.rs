//! Where iterations run. `train` plans and decides; a backend owns the splats between steps.

use super::appearance::Appearance;
use super::density::Change;
use super::gaussians::Gaussians;
use super::objective::{LossWeights, Losses};
use super::recipe::{Growth, SiteLengths};

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
    pub population: Population,
}

/// Changes to the splats' number and opacity after a step.
#[derive(Clone, Debug, Default)]
pub struct Population {
    /// Double the splats that ask for it.
    pub grow: Option<(Growth, SiteLengths)>,
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

/// What training has made.
#[derive(Clone, Debug)]
pub struct Snapshot {
    /// The splats.
    pub splats: Gaussians,
    /// Radiometry of every view.
    pub appearances: Vec<Appearance>,
}

/// Runs whole iterations on some hardware.
pub trait TrainingBackend {
    /// Runs one iteration.
    fn step(&mut self, plan: &StepPlan) -> StepReport;
    /// What training has made so far.
    fn snapshot(&self) -> Snapshot;
}
