//! What differs between the trainings of satellite images and of photographs.

use super::{BackendError, StepPlan};
use crate::splat::loss::Losses;
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;

/// The training views of a scene: their images, how splats are rendered for them, and how picture and image are compared.
pub trait ViewModel {
    /// What a picture is rendered from.
    type Viewpoint;
    /// A rendered picture.
    type Picture;

    /// Number of training views.
    fn views(&self) -> usize;

    /// Number of colour models that a state has: one for each view, or none.
    fn appearances(&self) -> usize;

    /// Lowest and highest altitude of splats, metres above the site's origin; those outside are pruned, and the others are kept in
    /// the order of their altitudes. None if no axis of the scene is the vertical one.
    fn altitudes(&self) -> Option<(f64, f64)>;

    /// Runs an iteration up to and including the optimiser's step. The view of the plan exists.
    ///
    /// # Errors
    /// [`BackendError`] if the image cannot be compared with the picture.
    fn step(
        &mut self,
        state: &mut TrainingState,
        plan: &StepPlan,
        watch: &mut Stopwatch,
    ) -> Result<Losses, BackendError>;

    /// Renders a picture, with the colour model of the training view of this index, if there are colour models. The view exists.
    fn picture(&self, state: &TrainingState, from: &Self::Viewpoint, view: usize) -> Self::Picture;
}
