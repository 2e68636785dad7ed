//! A stage that trains: its checkpoint, its iterations, its log. The trainings of satellite scenes, of photographs and of
//! colours differ in what they start from and what they write.

use super::PipelineError;
use super::run_folder::stage::{Fingerprint, Stage};
use super::train_options::TrainOptions;
use super::trained::mean;
use crate::io::{RgbImage, WriteError, write_atomically, write_json};
use crate::progress::{Event, Progress};
use crate::run_files::{CHECKPOINT, CHECKPOINT_CAMERAS, SNAPSHOTS, TRAINING_CURVES, TRAINING_LOG};
use crate::splat::backend::{BackendError, CpuBackend, TrainingBackend, ViewModel};
use crate::splat::state::TrainingState;
use crate::splat::train::checkpoint::Checkpoint;
use crate::splat::train::{LogLine, Schedule, pictures, train};
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// A stage that trains.
pub struct TrainingStage<'a> {
    stage: Stage,
    folder: PathBuf,
    options: &'a TrainOptions,
    progress: &'a dyn Progress,
}

/// A training so far: before its first iteration, after an interruption, or at its end.
#[derive(Clone)]
pub struct TrainingSoFar {
    /// Number of splats before the first iteration.
    pub splats_at_start: usize,
    /// The log of the iterations that are done.
    pub log: Vec<LogLine>,
    /// The state after the last of them.
    pub state: TrainingState,
}

impl TrainingSoFar {
    /// A training before its first iteration.
    pub fn start(state: TrainingState) -> Self {
        Self { splats_at_start: state.splats.len(), log: Vec::new(), state }
    }

    /// Mean of a column of the log over the last iteration of each of so many views; NaN of an empty log.
    pub fn mean_of_last(&self, views: usize, column: &str) -> f64 {
        mean(self.log[self.log.len().saturating_sub(views)..].iter().map(|line| line.column(column)))
    }

    /// Time of the iterations, seconds.
    pub fn seconds(&self) -> f64 {
        self.log.last().map_or(0.0, |line| line.seconds)
    }
}

impl<'a> TrainingStage<'a> {
    /// The stage of `run` called `name` that trains `outputs` from `fingerprint`.
    pub fn new(
        run: &Path,
        name: &'static str,
        outputs: &[&str],
        fingerprint: Fingerprint,
        (options, progress): (&'a TrainOptions, &'a dyn Progress),
    ) -> Self {
        let outputs = outputs.iter().map(|name| run.join(name)).collect();
        Self { stage: Stage::new(run, name, outputs, fingerprint), folder: run.join(name), options, progress }
    }

    /// [`Stage::is_done`].
    pub fn is_done(&self) -> Result<bool, PipelineError> {
        self.stage.is_done(self.options.overwrite)
    }

    /// [`Stage::summary`].
    pub fn summary<S: serde::de::DeserializeOwned>(&self) -> Result<Option<S>, PipelineError> {
        self.stage.summary()
    }

    /// [`Stage::require_writable`].
    pub fn require_writable(&self) -> Result<(), PipelineError> {
        self.stage.require_writable()
    }

    /// The training to continue: of the same input and options, with this number of colour models.
    ///
    /// A checkpoint of others is an error that names them, unless the options say to overwrite it. A damaged one is passed over
    /// with a warning; where `--resume` requires one it is an error, as is none.
    pub fn resume(&self, appearances: usize) -> Result<Option<TrainingSoFar>, PipelineError> {
        let (path, is_required) = (self.checkpoint(), self.options.resume);
        if !path.exists() {
            return if is_required { Err(PipelineError::NoCheckpoint { path }) } else { Ok(None) };
        }
        let checkpoint = match Checkpoint::read(&path) {
            Ok(checkpoint) => checkpoint,
            Err(e) if is_required => return Err(e.into()),
            Err(e) => {
                self.progress.event(Event::Warning(format!("{e}; training starts from the beginning")));
                return Ok(None);
            }
        };
        let is_same = self.stage.is_made_from(&checkpoint.origin, self.options.overwrite)?;
        if !is_same || !checkpoint.state.fits(appearances) {
            self.remove_checkpoint();
            return Ok(None);
        }
        let done = checkpoint.log.len();
        self.progress
            .event(Event::Note(format!("continuing from `{}` after {done} iterations", path.display())));
        let Checkpoint { splats_at_start, log, state, .. } = checkpoint;
        Ok(Some(TrainingSoFar { splats_at_start, log: log.into_owned(), state: state.into_owned() }))
    }

    /// Removes the pictures of a training before.
    pub fn remove_snapshots(&self) {
        let _ = std::fs::remove_dir_all(self.folder.join(SNAPSHOTS));
    }

    /// Runs the iterations of a schedule that are left, and writes the log. `snapshot` draws a picture of the training; none are
    /// written if it is none.
    ///
    /// # Errors
    /// [`PipelineError::TrainingInterrupted`] when the caller asks to stop: a checkpoint is written then.
    pub fn train<M: ViewModel>(
        &self,
        views: M,
        schedule: &Schedule,
        so_far: TrainingSoFar,
        snapshot: Option<Snapshot<CpuBackend<M>>>,
    ) -> Result<(M, TrainingSoFar), PipelineError> {
        let TrainingSoFar { splats_at_start, mut log, state } = so_far;
        let mut backend = CpuBackend::new(views, state)?;
        self.train_by(&mut backend, schedule, (splats_at_start, &mut log), snapshot)?;
        let (views, state) = backend.into_parts();
        Ok((views, TrainingSoFar { splats_at_start, log, state }))
    }

    /// As [`TrainingStage::train`], with a backend that has the state, whose training began with so many splats and has this log.
    ///
    /// # Errors
    /// As above.
    pub fn train_by<B: TrainingBackend + ?Sized>(
        &self,
        backend: &mut B,
        schedule: &Schedule,
        (splats_at_start, log): (usize, &mut Vec<LogLine>),
        snapshot: Option<Snapshot<B>>,
    ) -> Result<(), PipelineError> {
        let all = schedule.recipe.iterations;
        let is_picture_due =
            |done: u32| snapshot.is_some() && pictures::is_snapshot_due(self.options.snapshots, done, all);
        // That of the last iteration is for what follows, such as matching with the trained splats.
        let is_checkpoint_due = |done: u32| done == all || done.is_multiple_of(self.options.checkpoint_every);
        let is_due = |done: u32| is_picture_due(done) || is_checkpoint_due(done);
        self.progress.event(Event::Resumable(true));
        train(backend, schedule, log, self.progress, is_due, |backend, log| {
            let (done, is_interrupted) = (log.len() as u32, self.progress.is_cancelled());
            if let Some(draw) = snapshot.filter(|_| is_picture_due(done)) {
                let path = self.folder.join(SNAPSHOTS).join(format!("{done:06}.png"));
                // A missing picture is no reason to stop.
                if let Err(e) = draw(backend, done)?.write(&path) {
                    self.progress.event(Event::Warning(e.to_string()));
                }
            }
            if is_interrupted || is_checkpoint_due(done) {
                self.write_checkpoint(splats_at_start, log, backend.snapshot()?)?;
            }
            if is_interrupted {
                let (iterations, checkpoint) = (log.len(), self.checkpoint());
                return Err(PipelineError::TrainingInterrupted { iterations, checkpoint });
            }
            Ok(())
        })?;
        self.progress.event(Event::Resumable(false));
        tracing::info!("{}", backend.times().table());
        self.write_log(log)
    }

    /// Writes the cameras in whose frame the splats of the checkpoints are, for those who look at them.
    pub fn write_cameras(&self, cameras: &impl serde::Serialize) -> Result<(), PipelineError> {
        Ok(write_json(&self.folder.join(CHECKPOINT_CAMERAS), cameras)?)
    }

    /// Writes a line for each iteration, and the curves.
    pub fn write_log(&self, log: &[LogLine]) -> Result<(), PipelineError> {
        write_csv(&self.folder.join(TRAINING_LOG), log)?;
        Ok(pictures::curves(log).write(&self.folder.join(TRAINING_CURVES))?)
    }

    /// Records that the stage is complete; the checkpoint is not needed any more.
    pub fn complete(&self, summary: &impl serde::Serialize) -> Result<(), PipelineError> {
        self.stage.complete(summary)?;
        self.remove_checkpoint();
        Ok(())
    }

    fn checkpoint(&self) -> PathBuf {
        self.folder.join(CHECKPOINT)
    }

    fn write_checkpoint(
        &self,
        splats_at_start: usize,
        log: &[LogLine],
        state: &TrainingState,
    ) -> Result<(), PipelineError> {
        let origin = Cow::Borrowed(self.stage.fingerprint());
        let checkpoint = Checkpoint { origin, splats_at_start, log: log.into(), state: Cow::Borrowed(state) };
        Ok(checkpoint.write(&self.checkpoint())?)
    }

    /// A checkpoint that is left behind does no harm.
    fn remove_checkpoint(&self) {
        let _ = std::fs::remove_file(self.checkpoint());
        let _ = std::fs::remove_file(self.folder.join(CHECKPOINT_CAMERAS));
    }
}

/// Draws a picture of a training after so many iterations.
pub type Snapshot<'a, B> = &'a dyn Fn(&mut B, u32) -> Result<RgbImage, BackendError>;

fn write_csv(path: &Path, log: &[LogLine]) -> Result<(), WriteError> {
    let failed = |reason: String| WriteError::new(path, reason);
    write_atomically(path, |t| {
        let mut writer = csv::Writer::from_path(t).map_err(|e| failed(e.to_string()))?;
        writer.write_record(LogLine::header()).map_err(|e| failed(e.to_string()))?;
        for line in log {
            writer.write_record(line.record()).map_err(|e| failed(e.to_string()))?;
        }
        writer.flush().map_err(|e| failed(e.to_string()))
    })
}
