//! The device that trains photographs.

use super::super::PipelineError;
use super::super::gpu_support::unsupported_recipe;
use super::super::training_device::{AnyBackend, Needs, OnDevice, Opened};
use super::super::training_stage::{Snapshot, TrainingSoFar, TrainingStage};
use crate::estimate::DeviceTraining;
use crate::perspective::PinholeCamera;
use crate::progress::Progress;
use crate::splat::backend::{BackendError, CpuBackend, DeviceChoice, TrainingBackend};
use crate::splat::pinhole::{PinholePicture, PinholeView, PinholeViews, comparison};
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;
use std::sync::Arc;

/// Weights of the loss terms that a GPU computes.
const TERMS_ON_GPU: [&str; 2] = ["opacity", "opacity_sum"];

/// Trains on the device of the options, and returns its name if it is a GPU.
///
/// # Errors
/// Those of [`OnDevice::train`].
pub fn train_photographs(
    stage: &TrainingStage,
    views: &Arc<Vec<PinholeView>>,
    schedule: &Schedule,
    so_far: TrainingSoFar,
    (choice, progress): (DeviceChoice, &dyn Progress),
) -> Result<(TrainingSoFar, Option<String>), PipelineError> {
    let is_anchored = !so_far.state.anchored.anchorings().is_empty();
    let unsupported = unsupported_recipe(schedule.recipe, &TERMS_ON_GPU)
        .or_else(|| is_anchored.then(|| "GPUs do not train anchored splats of photographs".into()));
    let on_processor = |so_far: TrainingSoFar| {
        let model = PinholeViews::new(views.clone(), &so_far.state);
        let snapshot: Snapshot<CpuBackend<PinholeViews>> =
            &|backend, _| Ok(comparison(&views[0], &backend.render(&views[0].camera, 0)?));
        Ok(stage.train(model, schedule, so_far, Some(snapshot))?.1)
    };
    let snapshot: Snapshot<AnyBackend<PinholeCamera, PinholePicture>> =
        &|backend, _| Ok(comparison(&views[0], &backend.render(&views[0].camera, 0)?));
    let on_device = OnDevice { stage, schedule, choice, progress };
    let pixels = || views.iter().map(|view| (view.camera.size.0 * view.camera.size.1) as f64);
    let memory = DeviceTraining {
        splats: so_far.state.splats.len() as f64,
        pixels: pixels().fold(0.0, f64::max),
        all_pixels: pixels().sum(),
        sun_pixels: 0.0,
    };
    let needs = Needs { unsupported, appearances: 0, bytes: memory.photograph_bytes() };
    on_device.train(so_far, needs, |state| open(choice, views, state), snapshot, on_processor)
}

#[cfg(feature = "gpu")]
fn open(
    choice: DeviceChoice,
    views: &Arc<Vec<PinholeView>>,
    state: &TrainingState,
) -> Result<Opened<PinholeCamera, PinholePicture>, BackendError> {
    let gpu = super::super::training_device::open_gpu(choice)?;
    let name = gpu.info.name.clone();
    Ok((Box::new(crate::splat::gpu::GpuBackend::new(gpu, views.clone(), state.clone())?), name))
}

#[cfg(not(feature = "gpu"))]
fn open(
    _: DeviceChoice,
    _: &Arc<Vec<PinholeView>>,
    _: &TrainingState,
) -> Result<Opened<PinholeCamera, PinholePicture>, BackendError> {
    Err(BackendError::NoGpuSupport)
}
