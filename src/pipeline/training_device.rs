//! The device that trains.

use super::PipelineError;
use super::training_stage::{Snapshot, TrainingSoFar, TrainingStage};
use crate::progress::{Event, Progress};
use crate::splat::backend::{BackendError, DeviceChoice, TrainingBackend};
use crate::splat::state::TrainingState;
use crate::splat::train::Schedule;

/// A backend of views that pictures of this kind are rendered from.
pub type AnyBackend<V, P> = dyn TrainingBackend<Viewpoint = V, Picture = P>;

/// A backend on a GPU, and the name of the GPU.
pub type Opened<V, P> = (Box<AnyBackend<V, P>>, String);

/// What a training on a device needs to know.
pub struct OnDevice<'a> {
    /// The stage that trains.
    pub stage: &'a TrainingStage<'a>,
    /// Its schedule.
    pub schedule: &'a Schedule<'a>,
    /// Which device trains.
    pub choice: DeviceChoice,
    /// Where it is told.
    pub progress: &'a dyn Progress,
}

/// What a training needs of a GPU.
pub struct Needs {
    /// What it has that GPUs cannot do; none if they can train it.
    pub unsupported: Option<String>,
    /// Number of colour models in its checkpoints.
    pub appearances: usize,
    /// Memory that it takes at first.
    pub bytes: f64,
}

impl OnDevice<'_> {
    /// Trains on the device of the options, and returns its name if it is a GPU. With `auto`, a GPU that fails leaves the training to
    /// the processor, which continues from the last checkpoint. `open` makes the backend on a GPU, and `on_processor` trains on the
    /// processor.
    ///
    /// # Errors
    /// [`PipelineError::Option`] for a GPU that cannot train so; [`PipelineError::Backend`] if a GPU is asked for and fails; those of
    /// [`TrainingStage::train`].
    pub fn train<V, P>(
        &self,
        so_far: TrainingSoFar,
        Needs { unsupported, appearances, bytes }: Needs,
        open: impl FnOnce(&TrainingState) -> Result<Opened<V, P>, BackendError>,
        snapshot: Snapshot<AnyBackend<V, P>>,
        on_processor: impl FnOnce(TrainingSoFar) -> Result<TrainingSoFar, PipelineError>,
    ) -> Result<(TrainingSoFar, Option<String>), PipelineError> {
        let Some((mut backend, name)) = self.gpu(unsupported, || open(&so_far.state))? else {
            return Ok((on_processor(so_far)?, None));
        };
        let gigabytes = bytes / 1e9;
        self.progress
            .event(Event::Note(format!("training on {name}, with about {gigabytes:.1} GB of its memory")));
        let mut log = so_far.log.clone();
        let start = (so_far.splats_at_start, &mut log);
        let trained = self.stage.train_by(&mut *backend, self.schedule, start, Some(snapshot));
        match trained.and_then(|()| Ok(backend.snapshot()?.clone())) {
            Ok(state) => return Ok((TrainingSoFar { log, state, ..so_far }, Some(name))),
            Err(PipelineError::Backend(e)) if self.choice == DeviceChoice::Auto => {
                let text = format!("{e}; the processor continues from the last checkpoint");
                self.progress.event(Event::Warning(text));
            }
            Err(e) => return Err(e),
        }
        let so_far = self.stage.resume(appearances)?.unwrap_or(so_far);
        Ok((on_processor(so_far)?, None))
    }

    /// A GPU that trains, and its name; none where the processor does.
    fn gpu<V, P>(
        &self,
        unsupported: Option<String>,
        open: impl FnOnce() -> Result<Opened<V, P>, BackendError>,
    ) -> Result<Option<Opened<V, P>>, PipelineError> {
        let choice = self.choice;
        if choice == DeviceChoice::Cpu {
            return Ok(None);
        }
        let opened = match unsupported {
            Some(why) => Err((why, None)),
            None => open().map_err(|e| (e.to_string(), Some(e))),
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
                    self.progress.event(Event::Note(format!("training on the processor: {why}")));
                }
                Ok(None)
            }
        }
    }
}

/// Opens the GPU of a choice, if it computes what the processor does.
#[cfg(feature = "gpu")]
pub fn open_gpu(choice: DeviceChoice) -> Result<crate::splat::gpu::GpuDevice, BackendError> {
    let number = if let DeviceChoice::Gpu(number) = choice { number } else { None };
    let gpu = crate::splat::gpu::GpuDevice::open(number)?;
    gpu.self_test()?;
    Ok(gpu)
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use crate::estimate::TILES_OF_SPLAT;
    use crate::splat::gpu::{DevicePhotographs, DeviceSatellites, DeviceViews};

    #[test]
    fn memory_is_planned_for_the_room_that_trainings_begin_with() {
        let room = [DevicePhotographs::PAIRS_OF_SPLAT, DeviceSatellites::PAIRS_OF_SPLAT];
        assert_eq!(TILES_OF_SPLAT.map(u64::from), room);
    }
}
