//! The CPU backend. It executes an iteration within `submit`.

use super::{BackendError, StepPlan, StepReport, TrainingBackend, ViewModel, Wait};
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;

/// Runs iterations on all threads of the current rayon pool.
pub struct CpuBackend<M> {
    model: M,
    state: TrainingState,
    reports: Vec<StepReport>,
    watch: Stopwatch,
}

impl<M: ViewModel> CpuBackend<M> {
    /// A training of these views that starts from this state.
    ///
    /// # Errors
    /// [`BackendError::OtherAppearances`] if the state has another number of colour models than the views.
    pub fn new(model: M, state: TrainingState) -> Result<Self, BackendError> {
        let (found, expected) = (state.appearances.len(), model.appearances());
        if found != expected {
            return Err(BackendError::OtherAppearances { found, expected });
        }
        Ok(Self { model, state, reports: Vec::new(), watch: Stopwatch::default() })
    }

    /// The views and the state after the last iteration.
    pub fn into_parts(self) -> (M, TrainingState) {
        (self.model, self.state)
    }

    /// Refuses a view that the scene does not have.
    fn require(&self, view: usize) -> Result<(), BackendError> {
        let views = self.model.views();
        if view < views { Ok(()) } else { Err(BackendError::NoView { view, views }) }
    }
}

impl<M: ViewModel> TrainingBackend for CpuBackend<M> {
    type Viewpoint = M::Viewpoint;
    type Picture = M::Picture;

    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError> {
        self.require(plan.view)?;
        self.watch.begin();
        let losses = self.model.step(&mut self.state, plan, &mut self.watch)?;
        let counts = plan.densify.apply(&mut self.state, plan.iteration, self.model.altitudes());
        self.watch.lap("splats", "densification and pruning");
        let (splats, active) = (self.state.splats.len(), self.state.active.count());
        self.reports.push(StepReport { iteration: plan.iteration, losses, splats, active, counts });
        Ok(())
    }

    fn reports(&mut self, _: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError> {
        into.append(&mut self.reports);
        Ok(())
    }

    fn render(&mut self, from: &M::Viewpoint, view: usize) -> Result<M::Picture, BackendError> {
        self.require(view)?;
        Ok(self.model.picture(&self.state, from, view))
    }

    fn snapshot(&mut self) -> Result<&TrainingState, BackendError> {
        Ok(&self.state)
    }

    fn times(&self) -> &Stopwatch {
        &self.watch
    }
}
