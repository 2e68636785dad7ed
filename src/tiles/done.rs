//! What a job writes last: `done.json` of a complete tile, `failed.json` of one that failed.

use super::TilesError;
use super::plan::Tile;
use crate::io::{ReadError, read_json, write_json};
use crate::run_files::{DONE, FAILURE, TILES};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Size and hash of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileSeal {
    /// Size in bytes.
    pub bytes: u64,
    /// BLAKE3 hash of the content, hexadecimal.
    pub blake3: String,
}

/// Files by name, with sizes and hashes.
pub type Seals = BTreeMap<String, FileSeal>;

/// `done.json` of a tile: what it was made from, and its files. Nobody reads a tile's files without it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Done {
    /// [`Tile::input_hash`](super::Tile::input_hash) of the plan that the tile was made from.
    pub input_hash: String,
    /// Version of satgs that made the tile.
    pub satgs: String,
    /// Duration of the job, seconds.
    pub seconds: f64,
    /// Peak memory of the job, megabytes; none if the system does not tell.
    pub peak_memory_mb: Option<f64>,
    /// Number of splats.
    pub splats: usize,
    /// The tile's files, by their paths in its folder.
    pub files: Seals,
}

/// `failed.json` of a tile whose last job failed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// What went wrong, one sentence.
    pub reason: String,
}

impl FileSeal {
    /// Size and hash of a file.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read.
    pub fn of(path: &Path) -> Result<Self, ReadError> {
        let failed = |e| ReadError::new(path, e);
        let mut file = std::fs::File::open(path).map_err(failed)?;
        let mut hasher = blake3::Hasher::new();
        let bytes = std::io::copy(&mut file, &mut hasher).map_err(failed)?;
        Ok(Self { bytes, blake3: hasher.finalize().to_hex().to_string() })
    }

    /// Whether a file has this size.
    fn has_size(&self, path: &Path) -> bool {
        std::fs::metadata(path).is_ok_and(|file| file.is_file() && file.len() == self.bytes)
    }
}

/// Sizes and hashes of files in a folder.
///
/// # Errors
/// [`ReadError`] if a file cannot be read.
pub fn seal(folder: &Path, names: &[String]) -> Result<Seals, ReadError> {
    names.iter().map(|name| Ok((name.clone(), FileSeal::of(&folder.join(name))?))).collect()
}

/// Whether all files exist in a folder with their sizes. An empty list is not sound.
pub(super) fn are_sound(files: &Seals, folder: &Path) -> bool {
    !files.is_empty() && files.iter().all(|(name, seal)| seal.has_size(&folder.join(name)))
}

impl Done {
    /// Reads `done.json` of a tile; none if the tile is not done, or the file is damaged.
    #[must_use]
    pub fn read(folder: &Path) -> Option<Self> {
        read_json(&folder.join(DONE)).ok()
    }

    /// `done.json` of a tile that was made as the plan says and whose files are there; none if the tile is to be made.
    #[must_use]
    pub fn of_tile(run: &Path, tile: &Tile) -> Option<Self> {
        let folder = tile_folder(run, &tile.id);
        Self::read(&folder).filter(|done| done.input_hash == tile.input_hash && done.is_sound(&folder))
    }

    /// Writes `done.json` to the folder of a tile.
    ///
    /// # Errors
    /// [`TilesError`] if the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), TilesError> {
        Ok(write_json(&folder.join(DONE), self)?)
    }

    /// Whether all files exist with their sizes, so that a `done.json` whose files were removed or cut short is found.
    #[must_use]
    pub fn is_sound(&self, folder: &Path) -> bool {
        are_sound(&self.files, folder)
    }

    /// Whether all files have their hashes: reads all of them.
    #[must_use]
    pub fn is_intact(&self, folder: &Path) -> bool {
        let same = |(name, seal): (&String, &FileSeal)| {
            FileSeal::of(&folder.join(name)).is_ok_and(|found| found == *seal)
        };
        !self.files.is_empty() && self.files.iter().all(same)
    }
}

impl Failure {
    /// Reads `failed.json` of a tile; none if its last job did not fail.
    #[must_use]
    pub fn read(folder: &Path) -> Option<Self> {
        read_json(&folder.join(FAILURE)).ok()
    }

    /// Writes `failed.json` to the folder of a tile.
    ///
    /// # Errors
    /// [`TilesError`] if the file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<(), TilesError> {
        Ok(write_json(&folder.join(FAILURE), self)?)
    }
}

/// The run folder of a tile.
#[must_use]
pub fn tile_folder(run: &Path, id: &str) -> PathBuf {
    run.join(TILES).join(id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_done_file_whose_files_are_gone_or_changed_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("dsm.tif");
        std::fs::write(&path, "heights").unwrap();
        let files = seal(folder.path(), &["dsm.tif".into()]).unwrap();
        let done = Done { input_hash: "ab".into(), files, ..Done::default() };
        done.write(folder.path()).unwrap();
        let read = Done::read(folder.path()).unwrap();
        assert_eq!(read, done);
        assert!(read.is_sound(folder.path()) && read.is_intact(folder.path()));
        std::fs::write(&path, "heightz").unwrap();
        assert!(read.is_sound(folder.path()) && !read.is_intact(folder.path()));
        std::fs::write(&path, "height").unwrap();
        assert!(!read.is_sound(folder.path()));
        std::fs::remove_file(&path).unwrap();
        assert!(!read.is_sound(folder.path()));
        assert!(!Done::default().is_sound(folder.path()), "a tile without files is not done");
    }

    #[test]
    fn unknown_and_missing_fields_of_a_done_file_are_accepted() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(DONE), r#"{"input_hash": "ab", "host": "worker 3"}"#).unwrap();
        assert_eq!(Done::read(folder.path()).unwrap().input_hash, "ab");
        std::fs::write(folder.path().join(DONE), "{").unwrap();
        assert_eq!(Done::read(folder.path()), None);
    }
}
