//! The tie points of a cell of ground, and the file that stores them, so that an interrupted adjustment need not find them
//! again.

use crate::checkpoint;
use crate::io::WriteError;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// First line of the files. It names the version of satgs too, because another version may find other tie points.
const KIND: &str = concat!("satgs cell 1 of ", env!("CARGO_PKG_VERSION"));

/// A track of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CellTrack {
    /// Gray value of the point, 0 to 255.
    pub(super) gray: u8,
    /// Its observations.
    pub(super) observations: Vec<CellObservation>,
}

/// An observation of a track of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CellObservation {
    /// Index of the view in the scene.
    pub(super) view: u32,
    /// Column and row in the whole image; (0, 0) is the centre of the first pixel.
    pub(super) px: [f64; 2],
    /// Weight relative to other observations.
    pub(super) weight: f64,
}

/// What a cell gave: its tracks, or the reason why it has none.
pub(super) type CellResult = Result<Vec<CellTrack>, String>;

/// A file with the result of a cell.
pub(super) struct CellFile {
    path: PathBuf,
    key: String,
}

impl CellFile {
    /// The file of the cell `id`; `made_from` is all that its result depends on.
    pub(super) fn new(folder: &Path, id: &str, made_from: &str) -> Self {
        let key = blake3::hash(made_from.as_bytes()).to_hex().to_string();
        Self { path: folder.join(format!("{id}.bin")), key }
    }

    /// The stored result; none if there is no sound file that was made from the same.
    pub(super) fn read(&self) -> Option<CellResult> {
        let (key, result): (String, CellResult) = checkpoint::read(&self.path, KIND).ok()?;
        (key == self.key).then_some(result)
    }

    /// Stores a result.
    ///
    /// # Errors
    /// [`WriteError`].
    pub(super) fn write(&self, result: &CellResult) -> Result<(), WriteError> {
        checkpoint::write(&self.path, KIND, &(&self.key, result))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_result_is_read_back_from_a_sound_file_of_the_same_input_only() {
        let folder = tempfile::tempdir().unwrap();
        let file = CellFile::new(folder.path(), "x000_y001", "scene and box");
        assert_eq!(file.read(), None);
        let observation = CellObservation { view: 3, px: [0.1, 2e4], weight: 0.01 };
        let tracks = Ok(vec![CellTrack { gray: 7, observations: vec![observation; 2] }]);
        for result in [tracks, Err("water".to_owned())] {
            file.write(&result).unwrap();
            assert_eq!(file.read(), Some(result));
        }
        assert_eq!(CellFile::new(folder.path(), "x000_y001", "another scene").read(), None);
        let bytes = std::fs::read(&file.path).unwrap();
        std::fs::write(&file.path, &bytes[..bytes.len() - 9]).unwrap();
        assert_eq!(file.read(), None);
    }
}
