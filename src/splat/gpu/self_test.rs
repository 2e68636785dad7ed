//! Whether a device computes what the processor does: a few iterations of a small scene on both.

use super::backend::GpuBackend;
use super::device::GpuDevice;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::progress::NoProgress;
use crate::random::CounterRng;
use crate::splat::backend::{BackendError, CpuBackend, GpuError, TrainingBackend};
use crate::splat::pinhole::{PinholeView, PinholeViews};
use crate::splat::satellite::SatelliteViews;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;
use crate::splat::train::train;
use crate::splat::trial::{trial_recipe, trial_scene, trial_schedule, trial_start};
use glam::{DMat3, DVec2, DVec3};
use std::sync::Arc;

const ITERATIONS: u32 = 3;
const SPLATS: u64 = 300;
const SIZE: (usize, usize) = (48, 32);
/// Relative difference of losses up to which two devices agree.
const TOLERANCE: f64 = 1e-3;

impl GpuDevice {
    /// Compares a few iterations of photographs and of satellite views on the device with the same on the processor; it takes about
    /// two seconds.
    ///
    /// # Errors
    /// [`GpuError::Wrong`] if the losses differ; others if the device fails.
    pub fn self_test(&self) -> Result<(), BackendError> {
        let (views, state) = (Arc::new(vec![view()]), start());
        let found = losses("3dgs", &mut GpuBackend::new(self.clone(), views.clone(), state.clone())?)?;
        let model = PinholeViews::new(views, &state);
        self.require_same(found, losses("3dgs", &mut CpuBackend::new(model, state)?)?)?;
        let state = trial_start(SIZE, SPLATS);
        let on_device = GpuBackend::of_satellites(self.clone(), trial_scene(SIZE), state.clone());
        let found = losses("eogs", &mut on_device?)?;
        let model = SatelliteViews::new(trial_scene(SIZE), &state);
        self.require_same(found, losses("eogs", &mut CpuBackend::new(model, state)?)?)
    }

    fn require_same(&self, found: Vec<f64>, expected: Vec<f64>) -> Result<(), BackendError> {
        let agrees = |(a, b): (&f64, &f64)| (a - b).abs() <= TOLERANCE * b.abs();
        if found.len() == expected.len() && found.iter().zip(&expected).all(agrees) {
            return Ok(());
        }
        Err(GpuError::Wrong { device: self.info.name.clone(), found, expected }.into())
    }
}

/// The losses of the iterations by a recipe.
fn losses<B: TrainingBackend>(recipe: &str, backend: &mut B) -> Result<Vec<f64>, BackendError> {
    let Some(recipe) = trial_recipe(recipe, ITERATIONS) else { return Ok(Vec::new()) };
    let schedule = trial_schedule(&recipe, SPLATS);
    let mut log = Vec::new();
    train(backend, &schedule, &mut log, &NoProgress, |_| false, |_, _| Ok::<_, BackendError>(()))?;
    Ok(log.iter().map(|line| line.loss).collect())
}

/// A photograph of a pattern, taken 4 m in front of the origin.
fn view() -> PinholeView {
    let camera = PinholeCamera {
        cam_from_site: DMat3::IDENTITY,
        center: DVec3::new(0.0, 0.0, -4.0),
        focal: DVec2::splat(40.0),
        principal: DVec2::new(23.5, 15.5),
        size: SIZE,
    };
    let plane =
        |k: usize| Grid2::from_fn(SIZE.0, SIZE.1, |col, row| ((col * (k + 3) + row * 5) % 32) as f32 / 32.0);
    PinholeView::new("pattern".into(), camera, &[0, 1, 2].map(plane))
}

/// Random splats around the origin, with harmonics.
fn start() -> TrainingState {
    let mut splats = Splats::default();
    for i in 0..SPLATS {
        let mut draw = CounterRng::new(1, 0, 0, i);
        let position = [0; 3].map(|_| 2.0 * draw.normal() as f32);
        splats.push(
            position,
            0.1 + 0.3 * draw.uniform() as f32,
            0.1 + 0.8 * draw.uniform() as f32,
            [0.4, 0.5, 0.6],
        );
    }
    splats.f_rest.resize(splats.len(), [0.02; 45]);
    TrainingState::start(splats, Default::default(), 0, 0)
}
