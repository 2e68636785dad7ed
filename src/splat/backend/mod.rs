//! Where iterations run. `train` plans and decides; a backend owns the splats between steps.

pub mod checkpoint;
pub mod cpu;
pub mod stopwatch;

use crate::splat::densify::Change;
use crate::splat::objective::{LossWeights, Losses};
use crate::splat::splats::PerGroup;
use crate::splat::state::TrainingState;
use crate::splat::train::recipe::Densification;

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
    /// Adam's step lengths; that of positions in metres.
    pub rates: PerGroup<f64>,
    /// Adam's step length of the colour model.
    pub appearance_rate: f64,
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

/// Runs whole iterations on some hardware.
pub trait TrainingBackend {
    /// Runs one iteration.
    fn step(&mut self, plan: &StepPlan) -> StepReport;
    /// What training has made so far.
    fn snapshot(&mut self) -> &TrainingState;
}
