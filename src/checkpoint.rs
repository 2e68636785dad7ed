//! Checkpoint files, from which interrupted work continues.
//!
//! A file is a line that names its kind and version, the content in `postcard`'s encoding, and the BLAKE3 hash of
//! both, by which files that are cut short or changed are recognised.

use crate::io::{Cause, WriteError, write_atomically};
use serde::{Serialize, de::DeserializeOwned};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Why a checkpoint could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum CheckpointError {
    /// The file cannot be read.
    #[error("`{path}` cannot be read: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the file system.
        reason: String,
    },
    /// The file is damaged, or not a checkpoint of this version.
    #[error("`{path}` is not a valid checkpoint: {reason}")]
    #[diagnostic(help("remove it to start from the beginning"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: &'static str,
    },
}

/// Writes a file of a kind, such as `satgs checkpoint 1`; an older one is replaced as a whole.
///
/// # Errors
/// [`WriteError`].
pub fn write(path: &Path, kind: &str, content: &impl Serialize) -> Result<(), WriteError> {
    write_atomically(path, |temporary| stream(temporary, kind, content).map_err(|e| WriteError::new(path, e)))
}

fn stream(path: &Path, kind: &str, content: &impl Serialize) -> Result<(), Cause> {
    let mut file = Hashing { file: BufWriter::new(File::create(path)?), hash: blake3::Hasher::new() };
    writeln!(file, "{kind}")?;
    postcard::to_io(content, &mut file)?;
    let hash = file.hash.finalize();
    file.file.write_all(hash.as_bytes())?;
    Ok(file.file.flush()?)
}

/// Reads a file of a kind.
///
/// # Errors
/// [`CheckpointError`].
pub fn read<T: DeserializeOwned>(path: &Path, kind: &str) -> Result<T, CheckpointError> {
    let bytes =
        std::fs::read(path).map_err(|e| CheckpointError::Io { path: path.into(), reason: e.to_string() })?;
    decode(&bytes, kind).map_err(|reason| CheckpointError::Damaged { path: path.into(), reason })
}

fn decode<T: DeserializeOwned>(bytes: &[u8], kind: &str) -> Result<T, &'static str> {
    let header = bytes.strip_prefix(kind.as_bytes()).and_then(|rest| rest.strip_prefix(b"\n"));
    let body = header.ok_or("it is of another program or version")?;
    let (body, hash) = body.split_last_chunk::<{ blake3::OUT_LEN }>().ok_or("it is cut short")?;
    if blake3::hash(&bytes[..bytes.len() - blake3::OUT_LEN]) != *hash {
        return Err("it is cut short or changed");
    }
    postcard::from_bytes(body).map_err(|_| "its content is of another version")
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

    const KIND: &str = "satgs test 1";

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("values.bin");
        let values: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        write(&path, KIND, &values).unwrap();
        assert_eq!(read::<Vec<f32>>(&path, KIND).unwrap(), values);
    }

    #[test]
    fn cut_changed_foreign_and_absent_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("values.bin");
        assert!(matches!(read::<Vec<u8>>(&path, KIND), Err(CheckpointError::Io { .. })));
        write(&path, KIND, &vec![7u8; 1000]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let is_refused = |bytes: &[u8]| decode::<Vec<u8>>(bytes, KIND).is_err();
        for part in 0..100 {
            assert!(is_refused(&bytes[..bytes.len() * part / 100]), "{part} % of it");
            let mut changed = bytes.clone();
            changed[bytes.len() * part / 100] ^= 1;
            assert!(is_refused(&changed), "changed at {part} %");
        }
        assert!(is_refused(b"ply\nformat"));
        assert!(matches!(read::<Vec<u8>>(&path, "satgs test 2"), Err(CheckpointError::Damaged { .. })));
    }
}
