//! The training views of a perspective scene.

use super::objective::{AnyPinholeObjective, PinholeStep, objective};
use super::picture::PinholePicture;
use super::view::PinholeView;
use super::working_frame::NEAREST;
use crate::perspective::PinholeCamera;
use crate::splat::backend::{BackendError, StepPlan, ViewModel};
use crate::splat::loss::{Losses, TermInputs, terms};
use crate::splat::raster::Image;
use crate::splat::seen_gradient::SeenGradient;
use crate::splat::state::TrainingState;
use crate::splat::stopwatch::Stopwatch;
use std::sync::Arc;

/// The views of a perspective scene with the buffers of their iterations.
pub struct PinholeViews {
    views: Arc<Vec<PinholeView>>,
    objective: Box<dyn AnyPinholeObjective<f32>>,
    gradient: SeenGradient,
    target: Image<f32>,
    valid: Vec<bool>,
}

impl PinholeViews {
    /// Views in the [`WorkingFrame`](super::WorkingFrame), whose training starts from a state, whose kind of splats stays.
    #[must_use]
    pub fn new(views: Arc<Vec<PinholeView>>, start: &TrainingState) -> Self {
        Self {
            views,
            objective: objective(start.splats.primitive(), terms(TermInputs::default())),
            gradient: SeenGradient::default(),
            target: Image::default(),
            valid: Vec::new(),
        }
    }
}

impl ViewModel for PinholeViews {
    type Viewpoint = PinholeCamera;
    type Picture = PinholePicture;

    fn views(&self) -> usize {
        self.views.len()
    }

    /// Photographs have no colour model.
    fn appearances(&self) -> usize {
        0
    }

    fn altitudes(&self) -> Option<(f64, f64)> {
        None
    }

    fn step(
        &mut self,
        state: &mut TrainingState,
        plan: &StepPlan,
        watch: &mut Stopwatch,
    ) -> Result<Losses, BackendError> {
        let Self { views, objective, gradient, target, valid } = self;
        let view = &views[plan.view];
        let background = if view.has_empty_pixels() { plan.random_background } else { plan.background };
        view.load(background, target, valid);
        watch.lap("view", "image");
        let TrainingState { splats, adam, statistics, anchored, .. } = state;
        let input = PinholeStep {
            camera: &view.camera,
            nearest: NEAREST,
            target,
            valid,
            priors: Some(view.priors()),
            anchored: anchored.anchorings(),
            background,
            sh_degree: plan.sh_degree,
            surface: plan.surface,
        };
        let losses = objective.evaluate(splats, &input, &plan.weights, gradient, watch);
        let (width, height) = view.camera.size;
        let half_sides = [0.5 * width as f32, 0.5 * height as f32];
        let in_half_sides = |place: usize| {
            objective.mean2d_gradient(place).map(|g| [g[0] * half_sides[0], g[1] * half_sides[1]])
        };
        statistics.add_seen(gradient, in_half_sides);
        watch.lap("splats", "statistics");
        // Where splats are anchored, all are seen.
        anchored.add_to_anchors(&mut gradient.of_seen);
        anchored.step(splats, |splats| adam.step_seen(splats, gradient, &plan.rates));
        watch.lap("splats", "Adam");
        Ok(losses)
    }

    fn picture(&self, state: &TrainingState, from: &PinholeCamera, _: usize) -> PinholePicture {
        PinholePicture::render(&state.splats, from, NEAREST)
    }
}
