//! Keypoints of large images on disk: finding them takes minutes, and an adjustment that was interrupted need not do so
//! again.

use super::features::{Keypoint, VALUES, detect};
use crate::checkpoint;
use crate::frame::Pixel;
use crate::raster::RasterError;
use crate::scene::View;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// First line of the files; another content, or another way to find keypoints, is another version.
const KIND: &str = "satgs keypoints 1";
/// Pixels of an image whose keypoints are worth a file: some ten seconds' work.
const WORTH_A_FILE_PX: usize = 50_000_000;

/// A keypoint as it is stored.
#[derive(Serialize, Deserialize)]
struct Stored {
    px: [f64; 2],
    scale: f32,
    gray: u8,
    descriptor: Vec<f32>,
}

/// Keypoints of a view: from its file in `folder` if there is a sound one, else found, and kept there if the image is
/// large.
pub fn keypoints(view: &View, folder: Option<&Path>) -> Result<Vec<Keypoint>, RasterError> {
    let is_large = view.width * view.height >= WORTH_A_FILE_PX;
    let file = folder.filter(|_| is_large).map(|f| f.join(format!("{}.bin", view.name)));
    if let Some(kept) = file.as_deref().and_then(read) {
        return Ok(kept);
    }
    let image = view.brightness()?;
    let found = detect((view.width, view.height), |window| image.read(window))?;
    if let Some(file) = file {
        write(&file, &found)?;
    }
    Ok(found)
}

fn write(file: &Path, keypoints: &[Keypoint]) -> Result<(), RasterError> {
    let store = |k: &Keypoint| Stored {
        px: [k.px.col, k.px.row],
        scale: k.scale,
        gray: k.gray,
        descriptor: k.descriptor.to_vec(),
    };
    let stored: Vec<Stored> = keypoints.iter().map(store).collect();
    checkpoint::write(file, KIND, &stored)
}

fn read(file: &Path) -> Option<Vec<Keypoint>> {
    let stored: Vec<Stored> = checkpoint::read(file, KIND).ok()?;
    let keypoint = |s: Stored| {
        let descriptor: [f32; VALUES] = s.descriptor.try_into().ok()?;
        Some(Keypoint { px: Pixel::new(s.px[0], s.px[1]), scale: s.scale, gray: s.gray, descriptor })
    };
    stored.into_iter().map(keypoint).collect()
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
