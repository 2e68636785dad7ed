//! Checkpoints: what an interrupted training goes on from, in one file.
//!
//! The file is a line that names format and version, the content in `postcard`'s encoding, and the BLAKE3 hash of
//! both: a file that is cut short or changed is told from a whole one.

use super::backend::Snapshot;
use super::train::LogLine;
use crate::raster::{RasterError, write_atomically};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// First line of the file; another content is another version.
const HEADER: &[u8] = b"satgs checkpoint 1\n";

/// Why a checkpoint could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The system does not give it.
    #[error("`{path}` cannot be read: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's words.
        reason: String,
    },
    /// It is not, or no longer, a checkpoint of this version.
    #[error("`{path}` is no sound checkpoint: {reason}")]
    #[diagnostic(help("remove it to train from the start"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: &'static str,
    },
}

/// A training between two iterations: borrowed from one that is running, owned when read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint<'a> {
    /// What is trained by and from, so that only the same training goes on from it.
    pub origin: Cow<'a, BTreeMap<String, String>>,
    /// Splats that training started from.
    pub splats_at_start: usize,
    /// The log, up to the last iteration done.
    pub log: Cow<'a, [LogLine]>,
    /// Splats, moments, radiometry.
    pub state: Cow<'a, Snapshot>,
}

impl Checkpoint<'_> {
    /// Writes the file; an older one is replaced as a whole.
    ///
    /// # Errors
    /// [`RasterError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), RasterError> {
        write_atomically(path, |temporary| {
            self.stream(temporary)
                .map_err(|e| RasterError::Write { path: path.into(), reason: e.to_string() })
        })
    }

    fn stream(&self, path: &Path) -> Result<(), Box<dyn std::error::Error>> {
        let mut file = Hashing { file: BufWriter::new(File::create(path)?), hash: blake3::Hasher::new() };
        file.write_all(HEADER)?;
        postcard::to_io(self, &mut file)?;
        let hash = file.hash.finalize();
        file.file.write_all(hash.as_bytes())?;
        Ok(file.file.flush()?)
    }

    /// Reads a checkpoint.
    ///
    /// # Errors
    /// [`CheckpointError`].
    pub fn read(path: &Path) -> Result<Checkpoint<'static>, CheckpointError> {
        let bytes = std::fs::read(path)
            .map_err(|e| CheckpointError::Io { path: path.into(), reason: e.to_string() })?;
        decode(&bytes).map_err(|reason| CheckpointError::Damaged { path: path.into(), reason })
    }
}

fn decode(bytes: &[u8]) -> Result<Checkpoint<'static>, &'static str> {
    if !bytes.starts_with(HEADER) {
        return Err("it is of another program or version");
    }
    let (content, hash) = bytes.split_last_chunk::<{ blake3::OUT_LEN }>().ok_or("it is cut short")?;
    if blake3::hash(content) != *hash {
        return Err("it is cut short or changed");
    }
    let body = content.get(HEADER.len()..).ok_or("it is cut short")?;
    let checkpoint: Checkpoint<'static> =
        postcard::from_bytes(body).map_err(|_| "its content is of another version")?;
    if !checkpoint.state.fits(checkpoint.state.appearances.len()) {
        return Err("its parts do not belong together");
    }
    Ok(checkpoint)
}

/// A file, and the hash of what has been written to it.
struct Hashing {
    file: BufWriter<File>,
    hash: blake3::Hasher,
}

impl Write for Hashing {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let n = self.file.write(bytes)?;
        self.hash.update(&bytes[..n]);
        Ok(n)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::gaussians::Gaussians;

    fn checkpoint() -> Checkpoint<'static> {
        let mut splats = Gaussians::default();
        for i in 0..40 {
            splats.push([i as f32, f32::MIN_POSITIVE, -0.0], 0.3, 0.2, [0.1, 0.2, 0.3]);
        }
        let mut state = Snapshot::start(splats, 3);
        state.adam.steps = 70_000;
        state.statistics.rendered(|i| (i == 7).then_some([0.1, 0.2]), 3.0, 100.0);
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
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.bin");
        checkpoint().write(&path).unwrap();
        assert_eq!(Checkpoint::read(&path).unwrap(), checkpoint());
    }

    #[test]
    fn cut_changed_foreign_and_absent_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.bin");
        assert!(matches!(Checkpoint::read(&path), Err(CheckpointError::Io { .. })));
        checkpoint().write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for part in 0..100 {
            assert!(decode(&bytes[..bytes.len() * part / 100]).is_err(), "{part} % of it");
            let mut changed = bytes.clone();
            changed[bytes.len() * part / 100] ^= 1;
            assert!(decode(&changed).is_err(), "changed at {part} %");
        }
        assert!(decode(b"ply\nformat").is_err());
    }

    #[test]
    fn parts_of_different_numbers_of_splats_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("checkpoint.bin");
        let mut odd = checkpoint();
        odd.state.to_mut().adam.second.logit.pop();
        odd.write(&path).unwrap();
        assert!(matches!(Checkpoint::read(&path), Err(CheckpointError::Damaged { .. })));
    }
}
