//! The device that trains satellite scenes for their heights.

use super::super::PipelineError;
use super::super::gpu_support::unsupported_heights;
use super::super::training_device::{AnyBackend, Needs, OnDevice, Opened};
use super::super::training_stage::{Snapshot, TrainingSoFar, TrainingStage};
use super::training::Training;
use crate::affine::TrainingView;
use crate::estimate::DeviceTraining;
use crate::progress::Progress;
use crate::splat::backend::{BackendError, CpuBackend, DeviceChoice};
use crate::splat::satellite::{NovelView, Picture, SatelliteScene, SatelliteViews};
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;

/// Trains a scene on the device of the options, and returns its name if it is a GPU. `scene` makes the input of a training.
///
/// # Errors
/// Those of [`OnDevice::train`].
pub fn train_heights(
    (stage, training): (&TrainingStage, &Training),
    (views, scene): (&[TrainingView], &dyn Fn() -> SatelliteScene),
    schedule: &Schedule,
    so_far: TrainingSoFar,
    (choice, progress): (DeviceChoice, &dyn Progress),
) -> Result<(TrainingSoFar, Option<String>), PipelineError> {
    let on_processor = |so_far: TrainingSoFar| {
        let model = SatelliteViews::new(scene(), &so_far.state);
        let snapshot: Snapshot<CpuBackend<SatelliteViews>> =
            &|backend, done| training.picture(backend, views, done);
        Ok(stage.train(model, schedule, so_far, Some(snapshot))?.1)
    };
    let snapshot: Snapshot<AnyBackend<NovelView, Picture>> =
        &|backend, done| training.picture(backend, views, done);
    let on_device = OnDevice { stage, schedule, choice, progress };
    let pixels = || views.iter().map(|view| (view.width * view.height) as f64);
    let of_sun = views.iter().map(|view| sun_pixels(view, training.setup.altitudes));
    let memory = DeviceTraining {
        splats: so_far.state.splats.len() as f64,
        pixels: pixels().fold(0.0, f64::max),
        all_pixels: pixels().sum(),
        sun_pixels: of_sun.fold(0.0, f64::max),
    };
    let needs = Needs {
        unsupported: unsupported_heights(&training.recipe),
        appearances: views.len(),
        bytes: memory.satellite_bytes(),
    };
    on_device.train(so_far, needs, |state| open(choice, scene(), state), snapshot, on_processor)
}

/// Pixels of the image from the sun of a view.
fn sun_pixels(view: &TrainingView, altitudes: (f64, f64)) -> f64 {
    let novel = NovelView { camera: view.camera, size: (view.width, view.height), sun_shear: view.sun_shear };
    novel.sun(altitudes).map_or(0.0, |sun| (sun.image.camera.width * sun.image.camera.height) as f64)
}

#[cfg(feature = "gpu")]
fn open(
    choice: DeviceChoice,
    scene: SatelliteScene,
    state: &TrainingState,
) -> Result<Opened<NovelView, Picture>, BackendError> {
    let gpu = super::super::training_device::open_gpu(choice)?;
    let name = gpu.info.name.clone();
    Ok((Box::new(crate::splat::gpu::GpuBackend::of_satellites(gpu, scene, state.clone())?), name))
}

#[cfg(not(feature = "gpu"))]
fn open(
    _: DeviceChoice,
    _: SatelliteScene,
    _: &TrainingState,
) -> Result<Opened<NovelView, Picture>, BackendError> {
    Err(BackendError::NoGpuSupport)
}
