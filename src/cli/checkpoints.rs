//! The checkpoint of a training: taken up when it begins, kept while it goes on, removed when it is complete.

use super::stage::Stage;
use super::{Failure, Ui};
use crate::progress::{Event, Progress};
use crate::splat::backend::TrainingBackend;
use crate::splat::backend::checkpoint::Checkpoint;
use crate::splat::backend::cpu::CpuBackend;
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
        ui: &Ui,
    ) -> Result<Option<Checkpoint<'static>>, Failure> {
        if !self.path.exists() {
            if self.is_required {
                let message = format!("`{}` does not exist", self.path.display());
                return Err(Failure::input(message, "without --resume training begins at the start"));
            }
            return Ok(None);
        }
        let checkpoint = match Checkpoint::read(&self.path) {
            Ok(checkpoint) => checkpoint,
            Err(e) if self.is_required => return Err(e.into()),
            Err(e) => {
                ui.event(Event::Warning(format!("{e}; training begins at the start")));
                return Ok(None);
            }
        };
        if !self.stage.is_made_from(&checkpoint.origin, overwrite)? || !checkpoint.state.fits(views) {
            self.remove();
            return Ok(None);
        }
        let done = checkpoint.log.len();
        ui.note(&format!("going on from `{}` after {done} iterations", self.path.display()));
        Ok(Some(checkpoint))
    }

    /// Writes a checkpoint where one is due; when asked to stop, writes one and stops.
    pub fn keep(
        &self,
        splats_at_start: usize,
        log: &[LogLine],
        backend: &mut CpuBackend,
        progress: &dyn Progress,
    ) -> Result<(), Failure> {
        let interrupted = progress.is_cancelled();
        if interrupted || log.len().is_multiple_of(self.every as usize) {
            let origin = Cow::Borrowed(self.stage.fingerprint());
            let state = Cow::Borrowed(backend.snapshot());
            Checkpoint { origin, splats_at_start, log: log.into(), state }.write(&self.path)?;
        }
        if interrupted {
            let message = format!("interrupted after {} iterations", log.len());
            let hint = format!("the same command goes on from `{}`", self.path.display());
            return Err(Failure::interrupted(message, hint));
        }
        Ok(())
    }

    /// A complete training needs none; one that is left behind does no harm.
    pub fn remove(&self) {
        let _ = std::fs::remove_file(&self.path);
    }
}
