//! The backend of perspective scenes on the CPU. It executes an iteration within `submit`.

use super::super::backend::stopwatch::Stopwatch;
use super::super::backend::{BackendError, DensifyPlan, StepPlan, StepReport, TrainingBackend, Wait};
use super::super::densify::DensifyCounts;
use super::super::loss::{TermInputs, terms};
use super::super::objective::Losses;
use super::super::raster::Image;
use super::super::seen_gradient::SeenGradient;
use super::super::state::TrainingState;
use super::objective::{AnyPinholeObjective, PinholeStep, objective};
use super::picture::PinholePicture;
use super::view::PinholeView;
use super::working_frame::NEAREST;
use crate::perspective::PinholeCamera;
use std::sync::Arc;

/// The input of a training of a perspective scene.
pub struct PinholeScene {
    /// The training views, in the [`WorkingFrame`](super::WorkingFrame).
    pub views: Arc<Vec<PinholeView>>,
}

/// Runs iterations on all threads of the current rayon pool.
#[derive(Default)]
pub struct PinholeBackend {
    loaded: Option<Loaded>,
    reports: Vec<StepReport>,
    watch: Stopwatch,
}

/// A loaded training with the buffers of its iterations.
struct Loaded {
    scene: PinholeScene,
    state: TrainingState,
    objective: Box<dyn AnyPinholeObjective<f32>>,
    gradient: SeenGradient,
    target: Image<f32>,
    valid: Vec<bool>,
}

impl PinholeBackend {
    /// The time that each part of the iterations took.
    #[must_use]
    pub fn times(&self) -> &Stopwatch {
        &self.watch
    }

    fn loaded(&self) -> Result<&Loaded, BackendError> {
        self.loaded.as_ref().ok_or(BackendError::NotLoaded)
    }
}

impl TrainingBackend for PinholeBackend {
    type Scene = PinholeScene;
    type Viewpoint = PinholeCamera;
    type Picture = PinholePicture;

    fn load(&mut self, scene: PinholeScene, state: TrainingState) -> Result<(), BackendError> {
        // Photographs have no colour model.
        let found = state.appearances.len();
        if found != 0 {
            return Err(BackendError::OtherScene { found, expected: 0 });
        }
        self.loaded = Some(Loaded {
            objective: objective(state.splats.primitive(), terms(TermInputs::default())),
            scene,
            state,
            gradient: SeenGradient::default(),
            target: Image::default(),
            valid: Vec::new(),
        });
        self.reports.clear();
        Ok(())
    }

    fn submit(&mut self, plan: &StepPlan) -> Result<(), BackendError> {
        let loaded = self.loaded.as_mut().ok_or(BackendError::NotLoaded)?;
        let losses = loaded.step(plan, &mut self.watch)?;
        let counts = loaded.edit_splats(&plan.densify, plan.iteration);
        self.watch.lap("splats", "densification and pruning");
        let (splats, active) = (loaded.state.splats.len(), loaded.state.active.count());
        self.reports.push(StepReport { iteration: plan.iteration, losses, splats, active, counts });
        Ok(())
    }

    fn reports(&mut self, _: Wait, into: &mut Vec<StepReport>) -> Result<(), BackendError> {
        into.append(&mut self.reports);
        Ok(())
    }

    fn render(&mut self, from: &PinholeCamera, _: usize) -> Result<PinholePicture, BackendError> {
        Ok(PinholePicture::render(&self.loaded()?.state.splats, from, NEAREST))
    }

    fn snapshot(&mut self) -> Result<&TrainingState, BackendError> {
        Ok(&self.loaded()?.state)
    }
}

impl Loaded {
    /// One iteration up to and including the optimiser's step.
    fn step(&mut self, plan: &StepPlan, watch: &mut Stopwatch) -> Result<Losses, BackendError> {
        watch.begin();
        let Self { scene, state, objective, gradient, target, valid } = self;
        let (view, views) = (plan.view, scene.views.len());
        let view = scene.views.get(view).ok_or(BackendError::NoView { view, views })?;
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

    /// Densification, pruning and opacity reset after an iteration.
    fn edit_splats(&mut self, plan: &DensifyPlan, iteration: u32) -> DensifyCounts {
        let (state, mut counts) = (&mut self.state, DensifyCounts::default());
        if let Some((rule, extent_m)) = &plan.densify {
            counts.densified = state.densify(rule, *extent_m, (plan.seed, u64::from(iteration)));
        }
        if let Some(opacity) = plan.prune_below {
            let (largest_m, everywhere) = (plan.prune_above_m.unwrap_or(f64::INFINITY), (f64::MIN, f64::MAX));
            counts.pruned = state.prune(opacity, largest_m, everywhere);
            state.statistics.reset(state.splats.len());
        }
        if let Some(opacity) = plan.reset_opacity {
            state.reset_opacity(opacity);
        }
        counts
    }
}
