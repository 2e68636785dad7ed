//! Backends run the iterations of a training: [`train`](super::train) plans each iteration, and a backend owns the splats and
//! executes the plans.
//!
//! Execution is asynchronous: a plan is submitted without waiting for the reports of earlier ones, so that a GPU need not
//! copy results back in every iteration. No plan depends on a report.

mod cpu;
mod device_choice;
#[cfg(feature = "gpu")]
mod gpu_error;
mod view_model;

pub use cpu::CpuBackend;
pub use device_choice::DeviceChoice;
#[cfg(feature = "gpu")]
pub use gpu_error::GpuError;
pub use view_model::ViewModel;

use super::densify::DensifyCounts;
use super::loss::{LossWeights, Losses, SurfaceDepth};
use super::recipe::{Densification, NetworkRates};
use super::splats::PerGroup;
use super::state::TrainingState;
use super::stopwatch::Stopwatch;
use super::visibility::VisibilityError;
use crate::fault::ErrorKind;

/// The plan of one iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct StepPlan {
    /// Iteration, from 1.
    pub iteration: u32,
    /// Index of the rendered training view.
    pub view: usize,
    /// Resolution level: 0 full, 1 half.
    pub level: usize,
    /// Whether shadows are modelled; views without a known sun have none.
    pub shadows: bool,
    /// Random shear of the virtual view (column, row), half image sides per metre of altitude; none without a virtual view.
    pub virtual_shear: Option<[f64; 2]>,
    /// Linear colour behind the splats.
    pub background: [f32; 3],
    /// The same in photographs with empty pixels: random, so that splats of the colour of a background do not stand there
    /// (instant-ngp, nerfstudio).
    pub random_background: [f32; 3],
    /// Weights of the loss terms.
    pub weights: LossWeights,
    /// Number of splats by which the opacity loss divides the sum of opacities (EOGS: the initial number); the current
    /// number if none is given.
    pub opacity_divisor: Option<usize>,
    /// Degree of the spherical harmonics that are used, 0 to 3; satellite scenes have none above 0.
    pub sh_degree: usize,
    /// Which depth of discs in perspective scenes is the surface's.
    pub surface: SurfaceDepth,
    /// Learning rates of Adam; that of positions is in metres.
    pub rates: PerGroup<f64>,
    /// Learning rate of Adam for the colour model.
    pub appearance_rate: f64,
    /// Learning rates of Adam for what all views share of the colour model.
    pub network_rates: NetworkRates,
    /// Densification, pruning and opacity reset after the optimiser's step.
    pub densify: DensifyPlan,
    /// Place of the crop that the perceptual term compares: 0 to 1 from the left and from the top of where it may lie; none in
    /// iterations without the term.
    pub crop: Option<[f64; 2]>,
    /// The share, 0 to 1, to which the visibility of pixels counts; none while images and pictures are not compared.
    pub visibility: Option<f64>,
    /// Seed of random numbers within the iteration.
    pub seed: u64,
}

/// Densification, pruning and opacity reset after an iteration, in this order; each is left out if none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DensifyPlan {
    /// The rule of densification, and the half side in metres of the cube that its lengths refer to.
    pub densify: Option<(Densification, f64)>,
    /// Splats with a smaller opacity are removed.
    pub prune_below: Option<f64>,
    /// Splats with a larger scale are removed where others are, metres.
    pub prune_above_m: Option<f64>,
    /// Opacities above this are lowered to it.
    pub reset_opacity: Option<f64>,
    /// Seed of the random positions of split splats.
    pub seed: u64,
}

impl DensifyPlan {
    /// Whether nothing is done.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.densify.is_none() && self.prune_below.is_none() && self.reset_opacity.is_none()
    }

    /// Densifies, prunes and resets after an iteration. `altitudes` are those of [`ViewModel::altitudes`].
    pub fn apply(
        &self,
        state: &mut TrainingState,
        iteration: u32,
        altitudes: Option<(f64, f64)>,
    ) -> DensifyCounts {
        let mut counts = DensifyCounts::default();
        if let Some((rule, half_side_m)) = &self.densify {
            counts.densified = state.densify(rule, *half_side_m, (self.seed, u64::from(iteration)));
        }
        if let Some(opacity) = self.prune_below {
            let largest_m = self.prune_above_m.unwrap_or(f64::INFINITY);
            counts.pruned = state.prune(opacity, largest_m, altitudes.unwrap_or((f64::MIN, f64::MAX)));
            state.statistics.reset(state.splats.len());
        }
        if let Some(opacity) = self.reset_opacity {
            state.reset_opacity(opacity);
        }
        if self.prune_below.is_some() && altitudes.is_some() {
            state.sort_by_altitude();
        }
        counts
    }
}

/// The results of a completed iteration.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepReport {
    /// Iteration, from 1.
    pub iteration: u32,
    /// The loss and the columns of its terms.
    pub losses: Losses,
    /// Number of splats after the iteration.
    pub splats: usize,
    /// Number of active splats after the iteration, for active growth.
    pub active: usize,
    /// Numbers of densified and pruned splats.
    pub counts: DensifyCounts,
}

/// Whether to wait for iterations that are not complete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wait {
    /// Do not wait: return the reports that are available.
    No,
    /// Wait until all submitted iterations are complete.
    ForAll,
}

/// Why a backend cannot execute a request.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum BackendError {
    /// See [`VisibilityError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Visibility(#[from] VisibilityError),
    /// See [`GpuError`].
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    #[diagnostic(transparent)]
    Gpu(#[from] GpuError),
    /// The program is built without GPUs.
    #[cfg(not(feature = "gpu"))]
    #[error("this program is built without the feature `gpu`")]
    NoGpuSupport,
    /// The state has another number of colour models than the views need.
    #[error("the training state has {found} colour models, but the views need {expected}")]
    OtherAppearances {
        /// Number of colour models of the state.
        found: usize,
        /// Number that the views need.
        expected: usize,
    },
    /// A plan names a view that the scene does not have.
    #[error("view {view} was requested, but the scene has only {views} views")]
    NoView {
        /// Index of the view, from 0.
        view: usize,
        /// Number of views of the scene.
        views: usize,
    },
}

impl BackendError {
    /// Whose fault the failure is: unless images cannot be compared, that of the program.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Visibility(e) => e.kind(),
            #[cfg(feature = "gpu")]
            Self::Gpu(e) => e.kind(),
            #[cfg(not(feature = "gpu"))]
            Self::NoGpuSupport => ErrorKind::Input,
            Self::OtherAppearances { .. } | Self::NoView { .. } => ErrorKind::Failed,
        }
    }
}

/// Executes the iterations of a training, on a CPU or another device.
pub trait TrainingBackend {
    /// What a picture is rendered from.
    type Viewpoint;
    /// A rendered picture.
    type Picture;

    /// Submits an iteration for execution.
    ///
    /// # Errors
    /// [`BackendError`] of this iteration or of an earlier one.
    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError>;

    /// Appends the reports of completed iterations that were not reported yet to `into`, in their order.
    ///
    /// # Errors
    /// [`BackendError`] of any submitted iteration.
    fn reports(&mut self, wait: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError>;

    /// Renders a picture after all submitted iterations, with the colour model of the training view of this index, if the scene
    /// has colour models.
    ///
    /// # Errors
    /// [`BackendError::NoView`] if there is no such view; [`BackendError`] of any submitted iteration.
    fn render(&mut self, from: &Self::Viewpoint, view: usize) -> Result<Self::Picture, BackendError>;

    /// The state after all submitted iterations.
    ///
    /// # Errors
    /// [`BackendError`] of any submitted iteration.
    fn snapshot(&mut self) -> Result<&TrainingState, BackendError>;

    /// The time that each part of the iterations took.
    fn times(&self) -> &Stopwatch;
}
