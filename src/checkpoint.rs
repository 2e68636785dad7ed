//! Checkpoint files, from which interrupted work continues.
//!
//! A file is a line that names its kind and version, the content in `postcard`'s encoding, and the BLAKE3 hash of
//! both, by which files that are cut short or changed are recognised.

use crate::io::{Cause, WriteError, write_atomically};
use crate::progress::{Event, Progress};
use serde::{Serialize, de::DeserializeOwned};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

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

/// First line of the files of parts. It names the version of satgs too, because another version may make other parts.
const PART: &str = concat!("satgs part 1 of ", env!("CARGO_PKG_VERSION"));

/// A folder with the finished parts of work, from which interrupted work continues.
///
/// A part is a file that knows what it was made from. A damaged one, and one that was made from something else, counts as none.
#[derive(Clone, Debug)]
pub struct PartStore {
    folder: PathBuf,
    made_from: String,
    /// Whether a part was read that was there.
    is_used: Arc<AtomicBool>,
}

impl PartStore {
    /// The store in a folder, which need not exist. `made_from` is what all parts depend on, such as a hash of the images.
    #[must_use]
    pub fn new(folder: impl Into<PathBuf>, made_from: impl Into<String>) -> Self {
        Self { folder: folder.into(), made_from: made_from.into(), is_used: Arc::default() }
    }

    /// The store of the same work in a folder within this one.
    #[must_use]
    pub fn within(&self, name: &str) -> Self {
        Self::new(self.folder.join(name), self.made_from.clone())
    }

    /// The stored part called `name`, else what `make` returns, which is then stored. `made_from` is what this part depends on beside
    /// what all parts do. Without a store, `make` is called.
    ///
    /// # Errors
    /// Those of `make`; [`WriteError`] if the part cannot be stored.
    pub fn part<T: Serialize + DeserializeOwned, E: From<WriteError>>(
        store: Option<&Self>,
        name: &str,
        made_from: &str,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let Some(store) = store else { return make() };
        let path = store.folder.join(format!("{name}.bin"));
        let key =
            blake3::hash(format!("{:?}", (&store.made_from, made_from)).as_bytes()).to_hex().to_string();
        let stored = read::<(String, T)>(&path, PART).ok().filter(|(own, _)| *own == key);
        if let Some((_, part)) = stored {
            store.is_used.store(true, Ordering::Relaxed);
            return Ok(part);
        }
        let part = make()?;
        store.write(&path, &(key, &part))?;
        Ok(part)
    }

    /// Writes the file of a part. It does not wait for the disk, as there are hundreds of parts: one that is lost with the power is made
    /// again.
    fn write(&self, path: &Path, content: &impl Serialize) -> Result<(), WriteError> {
        let failed = |e: std::io::Error| WriteError::new(path, e);
        std::fs::create_dir_all(&self.folder).map_err(failed)?;
        let temporary =
            tempfile::Builder::new().prefix(".satgs-").tempfile_in(&self.folder).map_err(failed)?;
        stream(temporary.path(), PART, content).map_err(|e| WriteError::new(path, e))?;
        temporary.persist(path).map_err(|e| failed(e.error))?;
        Ok(())
    }

    /// Reports that work continued from stored parts, if it did since the last report.
    pub fn tell(&self, progress: &dyn Progress) {
        if self.is_used.swap(false, Ordering::Relaxed) {
            progress.event(Event::Note(format!("continuing from `{}`", self.folder.display())));
        }
    }

    /// Removes all parts. What is left behind does no harm.
    pub fn remove(&self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
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
    use crate::progress::Recorder;

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

    #[test]
    fn a_part_is_made_once_for_the_same_input_and_again_for_another_or_when_it_is_damaged() {
        let folder = tempfile::tempdir().unwrap();
        let place = folder.path().join("parts");
        let store = |of: &str| PartStore::new(&place, of);
        let part = |store: &PartStore, of: &str, value: f32| -> f32 {
            PartStore::part(Some(store), "one", of, || Ok::<_, WriteError>(value)).unwrap()
        };
        assert_eq!(part(&store("scene"), "pair", 1.0), 1.0);
        assert_eq!(part(&store("scene"), "pair", 2.0), 1.0);
        assert_eq!(part(&store("scene"), "other pair", 3.0), 3.0);
        assert_eq!(part(&store("other scene"), "other pair", 4.0), 4.0);
        let file = place.join("one.bin");
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, &bytes[..bytes.len() - 1]).unwrap();
        assert_eq!(part(&store("other scene"), "other pair", 5.0), 5.0);
        let failed = PartStore::part(Some(&store("scene")), "one", "", || {
            Err::<f32, _>(WriteError::new(&file, "not made"))
        });
        assert!(failed.is_err());
        store("scene").remove();
        assert!(!place.exists());
        assert_eq!(part(&store("other scene"), "other pair", 6.0), 6.0);
    }

    #[test]
    fn work_that_goes_on_is_told_of_once() {
        let folder = tempfile::tempdir().unwrap();
        let store = PartStore::new(folder.path(), "scene").within("matching");
        let make = || PartStore::part(Some(&store), "one", "", || Ok::<_, WriteError>(1_u8)).unwrap();
        let told = || {
            let recorder = Recorder::default();
            store.tell(&recorder);
            recorder.events().len()
        };
        make();
        assert_eq!(told(), 0, "nothing was there");
        make();
        assert_eq!((told(), told()), (1, 0));
    }
}
