//! Files that store the keypoints of large images, so that an interrupted adjustment need not detect them again, which
//! takes minutes.

use super::features::{Keypoint, VALUES, detect};
use crate::checkpoint;
use crate::frame::Pixel;
use crate::io::{RasterError, ValidPixels, WriteError, vsi};
use crate::scene::View;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// First line of the files. It names the version of satgs too, because another version may detect other keypoints.
const KIND: &str = concat!("satgs keypoints 1 of ", env!("CARGO_PKG_VERSION"));
/// Images with fewer pixels are not worth a file: detection takes less than about ten seconds.
const WORTH_A_FILE_PX: usize = 50_000_000;
/// Length of the longest array that serde supports.
const PART: usize = 32;

/// A keypoint as it is stored.
#[derive(Serialize, Deserialize)]
struct Stored {
    px: [f64; 2],
    scale: f32,
    gray: u8,
    descriptor: [[f32; PART]; VALUES / PART],
}

/// Keypoints of a view: read from its file in `folder` if it is complete, else detected, and stored there if the image
/// is large.
pub fn keypoints(view: &View, folder: Option<&Path>) -> Result<Vec<Keypoint>, RasterError> {
    let is_large = view.width * view.height >= WORTH_A_FILE_PX;
    let image = view.gray_image()?;
    let valid = image.valid_pixels().map(ValidPixels::digest);
    let file = folder.filter(|_| is_large).map(|f| f.join(file_name(view, valid)));
    if let Some(kept) = file.as_deref().and_then(read) {
        return Ok(kept);
    }
    let found = detect((view.width, view.height), |window| image.read(window))?;
    if let Some(Err(e)) = file.map(|file| write(&file, &found)) {
        tracing::warn!("keypoints are not kept: {e}");
    }
    Ok(found)
}

/// Cache key of a view: it changes with the image file, the window, the bands, the stretch and the valid pixels.
fn file_name(view: &View, valid: Option<String>) -> PathBuf {
    let identity = |path: &Path| {
        if vsi::is_virtual(path) {
            return Some(format!("{path:?}, {}", vsi::identity(path).ok()?));
        }
        let file = std::fs::metadata(path).ok()?;
        let age = file.modified().ok()?.duration_since(SystemTime::UNIX_EPOCH).ok()?;
        Some(format!("{:?}", (path.canonicalize().ok()?, file.len(), age.as_nanos())))
    };
    let pixels = (identity(&view.image), valid, view.window, &view.bands, view.stretch_percent);
    format!("{}.bin", &blake3::hash(format!("{pixels:?}").as_bytes()).to_hex()[..32]).into()
}

fn write(file: &Path, keypoints: &[Keypoint]) -> Result<(), WriteError> {
    let store = |k: &Keypoint| {
        let mut descriptor = [[0.0; PART]; VALUES / PART];
        descriptor.as_flattened_mut().copy_from_slice(&k.descriptor);
        Stored { px: [k.px.col, k.px.row], scale: k.scale, gray: k.gray, descriptor }
    };
    let stored: Vec<Stored> = keypoints.iter().map(store).collect();
    checkpoint::write(file, KIND, &stored)
}

fn read(file: &Path) -> Option<Vec<Keypoint>> {
    let stored: Vec<Stored> = checkpoint::read(file, KIND).ok()?;
    let keypoint = |s: Stored| {
        let mut descriptor = [0.0; VALUES];
        descriptor.copy_from_slice(s.descriptor.as_flattened());
        Keypoint { px: Pixel::new(s.px[0], s.px[1]), scale: s.scale, gray: s.gray, descriptor }
    };
    Some(stored.into_iter().map(keypoint).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keypoints_are_read_back_from_a_sound_file_only() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a/b.bin");
        let descriptor = std::array::from_fn(|i| i as f32);
        let keypoint = Keypoint { px: Pixel::new(0.1, 2e4), scale: 0.75, gray: 255, descriptor };
        write(&file, &[keypoint.clone(), keypoint]).unwrap();
        let back = read(&file).unwrap();
        assert_eq!(back.len(), 2);
        assert_eq!((back[1].px, back[1].scale, back[1].gray), (Pixel::new(0.1, 2e4), 0.75, 255));
        assert_eq!(back[1].descriptor, descriptor);
        std::fs::write(&file, &std::fs::read(&file).unwrap()[..200]).unwrap();
        assert!(read(&file).is_none());
    }
}
