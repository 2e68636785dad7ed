//! The checkpoint of a training: taken up when it begins, kept while it goes on, removed when it is complete.

use super::PipelineError;
use super::stage::Stage;
use crate::progress::{Event, Progress};
use crate::splat::backend::TrainingBackend;
use crate::splat::backend::checkpoint::Checkpoint;
use crate::splat::train::LogLine;
use std::borrow::Cow;
use std::path::PathBuf;

/// The checkpoint of a stage that trains.
pub struct Checkpoints<'a> {
    /// The file.
    pub path: PathBuf,
    /// The stage.
    pub stage: &'a Stage,
    /// Iterations from one to the next.
    pub every: u32,
    /// Whether training must go on from one.
    pub is_required: bool,
}

impl Checkpoints<'_> {
    /// The checkpoint to go on from: of the same input and options, and for so many views.
    ///
    /// One of others is an error that names them, unless `overwrite`. A damaged one is passed over with a warning;
    /// where one is required it is an error, as is none.
    pub fn take_up(
        &self,
        views: usize,
        overwrite: bool,
        progress: &dyn Progress,
    ) -> Result<Option<Checkpoint<'static>>, PipelineError> {
        if !self.path.exists() {
            if self.is_required {
                return Err(PipelineError::NoCheckpoint { path: self.path.clone() });
            }
            return Ok(None);
        }
        let checkpoint = match Checkpoint::read(&self.path) {
            Ok(checkpoint) => checkpoint,
            Err(e) if self.is_required => return Err(e.into()),
            Err(e) => {
                progress.event(Event::Warning(format!("{e}; training starts from the beginning")));
                return Ok(None);
            }
        };
        if !self.stage.is_made_from(&checkpoint.origin, overwrite)? || !checkpoint.state.fits(views) {
            self.remove();
            return Ok(None);
        }
        let done = checkpoint.log.len();
        let path = self.path.display();
        progress.event(Event::Note(format!("going on from `{path}` after {done} iterations")));
        Ok(Some(checkpoint))
    }

    /// Writes a checkpoint where one is due; when asked to stop, writes one and stops.
    pub fn keep(
        &self,
        splats_at_start: usize,
        log: &[LogLine],
        backend: &mut impl TrainingBackend,
        progress: &dyn Progress,
    ) -> Result<(), PipelineError> {
        let interrupted = progress.is_cancelled();
        if interrupted || self.is_due(log.len() as u32) {
            let origin = Cow::Borrowed(self.stage.fingerprint());
            let state = Cow::Borrowed(backend.snapshot()?);
            Checkpoint { origin, splats_at_start, log: log.into(), state }.write(&self.path)?;
        }
        if interrupted {
            return Err(PipelineError::TrainingInterrupted {
                iterations: log.len(),
                checkpoint: self.path.clone(),
            });
        }
        Ok(())
    }

    /// Whether a checkpoint is due after so many iterations.
    pub fn is_due(&self, done: u32) -> bool {
        done.is_multiple_of(self.every)
    }

    /// A complete training needs none; one that is left behind does no harm.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
