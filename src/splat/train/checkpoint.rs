//! Checkpoint files, from which an interrupted training continues.

use crate::checkpoint::{CheckpointError, read, write};
use crate::io::WriteError;
use crate::splat::state::TrainingState;
use crate::splat::train::LogLine;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

/// First line of the file; it changes with the format.
const KIND: &str = "satgs checkpoint 7";

/// A training between two iterations. The parts are borrowed from a running training, or owned when read from a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint<'a> {
    /// Options and inputs of the training by name, so that only the same training continues from the checkpoint.
    pub origin: Cow<'a, BTreeMap<String, String>>,
    /// Initial number of splats.
    pub splats_at_start: usize,
    /// The log up to the last completed iteration.
    pub log: Cow<'a, [LogLine]>,
    /// Splats, moments and colour models.
    pub state: Cow<'a, TrainingState>,
}

impl Checkpoint<'_> {
    /// Writes the file atomically.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write(path, KIND, self)
    }

    /// Reads a checkpoint file.
    ///
    /// # Errors
    /// [`CheckpointError`] if the file cannot be read, has another version, or is damaged.
    pub fn read(path: &Path) -> Result<Checkpoint<'static>, CheckpointError> {
        let checkpoint: Checkpoint<'static> = read(path, KIND)?;
        if !checkpoint.state.fits(checkpoint.state.appearances.len()) {
            let reason = "its parts have different numbers of splats";
            return Err(CheckpointError::Damaged { path: path.into(), reason });
        }
        Ok(checkpoint)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::splats::Splats;

    fn checkpoint() -> Checkpoint<'static> {
        let mut splats = Splats::default();
        for i in 0..40 {
            splats.push([i as f32, f32::MIN_POSITIVE, -0.0], 0.3, 0.2, [0.1, 0.2, 0.3]);
        }
        let mut state = TrainingState::start(splats, Default::default(), 3, 0);
        state.adam.steps = 70_000;
        state.statistics.add_view(|i| (i == 7).then_some([0.1, 0.2]), 3.0, 100.0);
        let log = vec![LogLine { iteration: 1, seconds: 0.1, ..LogLine::default() }];
        let origin = BTreeMap::from([("seed".into(), "0".into())]);
        Checkpoint {
            origin: Cow::Owned(origin),
            splats_at_start: 39,
            log: log.into(),
            state: Cow::Owned(state),
        }
    }

    #[test]
    fn a_written_checkpoint_is_read_back_equal() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.bin");
        checkpoint().write(&path).unwrap();
        assert_eq!(Checkpoint::read(&path).unwrap(), checkpoint());
    }

    #[test]
    fn parts_of_different_numbers_of_splats_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.bin");
        let mut odd = checkpoint();
        odd.state.to_mut().adam.second.opacity_logit.pop();
        odd.write(&path).unwrap();
        assert!(matches!(Checkpoint::read(&path), Err(CheckpointError::Damaged { .. })));
    }
}
