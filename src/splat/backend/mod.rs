//! Where iterations run. `train` plans and decides; a backend owns the splats between steps.
//!
//! A backend answers later: a plan is submitted without waiting for the reports of those before it, so that a GPU need not
//! hand its buffers back at every step. No plan depends on a report.

pub mod checkpoint;
pub mod cpu;
pub mod stopwatch;

use super::appearance::AppearanceKind;
use super::densify::Change;
use super::loss::LossWeights;
use super::loss::surface_prior::Prior;
use super::novel_view::{NovelView, Picture};
use super::objective::Losses;
use super::splats::PerGroup;
use super::state::TrainingState;
use super::train::recipe::Densification;
use crate::affine::TrainingView;
use std::sync::Arc;

/// What a training is of; it does not change.
pub struct TrainingScene {
    /// The views.
    pub views: Arc<Vec<TrainingView>>,
    /// Lowest and highest altitude of the scene, metres above the site's origin.
    pub altitudes: (f64, f64),
    /// The surface that splats are held to.
    pub prior: Option<Arc<Prior>>,
    /// The colour model.
    pub appearance: AppearanceKind,
}

/// Everything one iteration does.
#[derive(Clone, Debug, PartialEq)]
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
    /// Weights of the loss's terms.
    pub weights: LossWeights,
    /// Number of splats by which the sum of opacities is divided for the loss (EOGS: that at the start); by default the
    /// present number.
    pub opacity_divisor: Option<usize>,
    /// Adam's step lengths; that of positions in metres.
    pub rates: PerGroup<f64>,
    /// Adam's step length for the colour model.
    pub appearance_rate: f64,
    /// Changes of the splats' number after the step.
    pub densify: DensifyPlan,
}

/// Changes to the splats' number and opacity after a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DensifyPlan {
    /// Double the splats that a rule names, in a cube of this half side, metres.
    pub grow: Option<(Densification, f64)>,
    /// Remove splats fainter than this.
    pub prune_below: Option<f64>,
    /// Lower opacities to this.
    pub reset_opacity: Option<f64>,
    /// Seed of the random places of split splats.
    pub seed: u64,
}

/// The figures of a step that is done.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    /// The iteration.
    pub iteration: u32,
    /// The loss and its terms.
    pub losses: Losses,
    /// Splats after the step.
    pub splats: usize,
    /// What growth and pruning did.
    pub change: Change,
}

/// Whether to wait for steps that are not done yet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Take the reports that are there.
    No,
    /// Wait until every submitted step is done.
    ForAll,
}

/// Why a backend cannot go on.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum BackendError {
    /// Nothing was loaded.
    #[error("the training backend has no scene")]
    NotLoaded,
    /// The state belongs to another scene.
    #[error("the state of a training of {found} views was loaded for a scene of {expected}")]
    OtherScene {
        /// Views of the state.
        found: usize,
        /// Views of the scene.
        expected: usize,
    },
    /// A plan names a view that the scene does not have.
    #[error("view {view} of a scene of {views} views is to be rendered")]
    NoView {
        /// Index of the view.
        view: usize,
        /// Views there are.
        views: usize,
    },
}

/// Runs whole iterations on some hardware.
pub trait TrainingBackend {
    /// Takes a scene and the state to go on from; what was loaded before is dropped.
    ///
    /// # Errors
    /// [`BackendError`].
    fn load(&mut self, scene: TrainingScene, state: TrainingState) -> Result<(), BackendError>;

    /// Queues an iteration.
    ///
    /// # Errors
    /// [`BackendError`], of this step or of one before.
    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError>;

    /// Appends the reports of steps that are done and were not reported yet, in their order.
    ///
    /// # Errors
    /// [`BackendError`], of any submitted step.
    fn reports(&mut self, wait: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError>;

    /// Renders the scene in the colours of a training view, after all submitted steps.
    ///
    /// # Errors
    /// [`BackendError`].
    fn render(&mut self, from: &NovelView, view: usize) -> Result<Picture, BackendError>;

    /// The state after all submitted steps.
    ///
    /// # Errors
    /// [`BackendError`].
    fn snapshot(&mut self) -> Result<&TrainingState, BackendError>;
}
