//! Masks of images.

use crate::io::vsi;
use std::path::{Path, PathBuf};

/// Ends of the names of masks.
const ENDS: [&str; 7] = ["png", "jpg", "jpeg", "JPG", "PNG", "tif", "bmp"];

/// A raster that says which pixels of an image are used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskFile {
    /// The raster, of the shape of the image.
    pub path: PathBuf,
    /// Whether the pixels that it marks, those that are neither black nor transparent, are used; else the others are.
    pub marks_used: bool,
}

impl MaskFile {
    /// A mask that is black where the image is not to be used.
    #[must_use]
    pub fn of_used(path: PathBuf) -> Self {
        Self { path, marks_used: true }
    }

    /// A mask that is black where the image is to be used.
    #[must_use]
    pub fn of_unused(path: PathBuf) -> Self {
        Self { path, marks_used: false }
    }
}

/// The mask of an image in a folder of masks: `NAME.EXT.png` (COLMAP), `NAME.png`, or another format in place of PNG.
pub(super) fn mask_in(folder: &Path, image: &str) -> Option<MaskFile> {
    let whole = ENDS.iter().map(|end| folder.join(format!("{image}.{end}")));
    let stem = ENDS.iter().map(|end| folder.join(image).with_extension(end));
    whole.chain(stem).find(|p| vsi::exists(p)).map(MaskFile::of_used)
}
