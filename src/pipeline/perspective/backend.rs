//! The device that trains photographs.

use super::super::PipelineError;
use super::super::training_stage::{Snapshot, TrainingSoFar, TrainingStage};
use crate::perspective::PinholeCamera;
use crate::progress::{Event, Progress};
use crate::splat::backend::{BackendError, CpuBackend, DeviceChoice, TrainingBackend};
use crate::splat::pinhole::{PinholePicture, PinholeView, PinholeViews, comparison};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::state::TrainingState;
use crate::splat::train::{LogLine, Schedule};
use std::sync::Arc;

/// A backend that trains photographs.
type PhotographBackend = dyn TrainingBackend<Viewpoint = PinholeCamera, Picture = PinholePicture>;

/// Weights of the loss terms that a GPU computes.
const TERMS_ON_GPU: [&str; 2] = ["opacity", "opacity_sum"];

/// Trains on the device of the options, and returns its name if it is a GPU. With `auto`, a GPU that fails leaves the training to the
/// processor, which goes on from the last checkpoint.
///
/// # Errors
/// [`PipelineError::Option`] for a GPU that cannot train so; [`PipelineError::Backend`] if a GPU is asked for and fails; those of
/// [`TrainingStage::train`].
pub fn train_photographs(
    stage: &TrainingStage,
    views: &Arc<Vec<PinholeView>>,
    schedule: &Schedule,
    so_far: TrainingSoFar,
    (choice, progress): (DeviceChoice, &dyn Progress),
) -> Result<(TrainingSoFar, Option<String>), PipelineError> {
    if let Some((mut backend, name)) = gpu(choice, views, schedule, &so_far.state, progress)? {
        progress.event(Event::Note(format!("training on {name}")));
        let mut log = so_far.log.clone();
        match train_by(stage, &mut *backend, views, schedule, (so_far.splats_at_start, &mut log)) {
            Ok(state) => return Ok((TrainingSoFar { log, state, ..so_far }, Some(name))),
            Err(PipelineError::Backend(e)) if choice == DeviceChoice::Auto => {
                progress
                    .event(Event::Warning(format!("{e}; the processor goes on from the last checkpoint")));
            }
            Err(e) => return Err(e),
        }
        let so_far = stage.resume(0)?.unwrap_or(so_far);
        return Ok((on_processor(stage, views, schedule, so_far)?, None));
    }
    Ok((on_processor(stage, views, schedule, so_far)?, None))
}

fn on_processor(
    stage: &TrainingStage,
    views: &Arc<Vec<PinholeView>>,
    schedule: &Schedule,
    so_far: TrainingSoFar,
) -> Result<TrainingSoFar, PipelineError> {
    let model = PinholeViews::new(views.clone(), &so_far.state);
    let snapshot: Snapshot<CpuBackend<PinholeViews>> =
        &|backend, _| Ok(comparison(&views[0], &backend.render(&views[0].camera, 0)?));
    Ok(stage.train(model, schedule, so_far, Some(snapshot))?.1)
}

fn train_by(
    stage: &TrainingStage,
    backend: &mut PhotographBackend,
    views: &[PinholeView],
    schedule: &Schedule,
    so_far: (usize, &mut Vec<LogLine>),
) -> Result<TrainingState, PipelineError> {
    let snapshot: Snapshot<PhotographBackend> =
        &|backend, _| Ok(comparison(&views[0], &backend.render(&views[0].camera, 0)?));
    stage.train_by(backend, schedule, so_far, Some(snapshot))?;
    Ok(backend.snapshot()?.clone())
}

/// A GPU that trains by the schedule, and its name; none where the processor does.
fn gpu(
    choice: DeviceChoice,
    views: &Arc<Vec<PinholeView>>,
    schedule: &Schedule,
    state: &TrainingState,
    progress: &dyn Progress,
) -> Result<Option<(Box<PhotographBackend>, String)>, PipelineError> {
    if choice == DeviceChoice::Cpu {
        return Ok(None);
    }
    let opened = match unsupported(schedule, state) {
        Some(why) => Err((why, None)),
        None => open(choice, views, state).map_err(|e| (e.to_string(), Some(e))),
    };
    match (opened, choice) {
        (Ok(gpu), _) => Ok(Some(gpu)),
        (Err((_, Some(e))), DeviceChoice::Gpu(_)) => Err(e.into()),
        (Err((why, None)), DeviceChoice::Gpu(_)) => Err(PipelineError::Option {
            option: "--device",
            found: format!("{choice}, but {why}"),
            expected: "auto or cpu",
        }),
        (Err((why, _)), _) => {
            // Without GPUs in the program there is no choice to tell of.
            if cfg!(feature = "gpu") {
                progress.event(Event::Note(format!("training on the processor: {why}")));
            }
            Ok(None)
        }
    }
}

/// What a training has that GPUs cannot do yet.
fn unsupported(schedule: &Schedule, state: &TrainingState) -> Option<String> {
    let of_terms = || schedule.recipe.weights.iter().filter(|(name, _)| !TERMS_ON_GPU.contains(name));
    if state.splats.primitive() == PrimitiveKind::Disc {
        Some("GPUs train ellipsoids only, not flat discs".into())
    } else if !state.anchored.anchorings().is_empty() {
        Some("GPUs do not train anchored splats".into())
    } else {
        let other = of_terms().find(|(_, weight)| *weight != 0.0)?;
        Some(format!("GPUs do not compute the loss term `{}`", other.0))
    }
}

#[cfg(feature = "gpu")]
fn open(
    choice: DeviceChoice,
    views: &Arc<Vec<PinholeView>>,
    state: &TrainingState,
) -> Result<(Box<PhotographBackend>, String), BackendError> {
    use crate::splat::gpu::{GpuBackend, GpuDevice};
    let number = if let DeviceChoice::Gpu(number) = choice { number } else { None };
    let gpu = GpuDevice::open(number)?;
    gpu.self_test()?;
    let name = gpu.info.name.clone();
    Ok((Box::new(GpuBackend::new(gpu, views.clone(), state.clone())?), name))
}

#[cfg(not(feature = "gpu"))]
fn open(
    _: DeviceChoice,
    _: &Arc<Vec<PinholeView>>,
    _: &TrainingState,
) -> Result<(Box<PhotographBackend>, String), BackendError> {
    Err(BackendError::NoGpuSupport)
}
