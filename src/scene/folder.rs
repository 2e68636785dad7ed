//! Layout 1: a folder of images, each with its RPC inside (tag, NITF) or beside it.
//!
//! As in GDAL, what lies beside an image wins over what is in it: `NAME_RPC.TXT` before `NAME.json` before other
//! sidecars that GDAL reads before the RPC tag. Where the two differ by more than 0.1 px a warning says so.

use super::source::{files_in, images_in, no_rpc, sidecar_of, stem, view};
use super::{SceneError, View};
use crate::raster::ImageFile;
use std::path::Path;

/// Reads the views of a folder.
pub(super) fn read(folder: &Path, warnings: &mut Vec<String>) -> Result<Vec<View>, SceneError> {
    let images = images_in(folder)?;
    let listing = files_in(folder)?;
    let (mut views, mut without) = (Vec::new(), Vec::new());
    for image in &images {
        let sidecar = sidecar_of(&stem(image), &listing).filter(|p| is_rpc(p));
        match view(image, sidecar.as_deref(), warnings)? {
            Some(view) => views.push(view),
            None => without.push(image),
        }
    }
    match (without.first(), views.is_empty()) {
        (None, true) => return Err(SceneError::NoImages { path: folder.into() }),
        (Some(image), true) => return Err(no_rpc(image)),
        _ => {}
    }
    for image in without {
        // A map among sensor images (a DEM, an orthophoto) is there for another purpose.
        if !ImageFile::open(image)?.has_geotransform() {
            return Err(no_rpc(image));
        }
        warnings.push(format!("`{}` is a map without an RPC, it is left out", image.display()));
    }
    Ok(views)
}

/// Whether a file that might be about anything (`NAME.txt`, `NAME.json`) is about an RPC.
fn is_rpc(path: &Path) -> bool {
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().to_lowercase());
    if name.contains("rpc") {
        return true;
    }
    let Ok(bytes) = std::fs::read(path) else { return true };
    let text = String::from_utf8_lossy(&bytes).to_lowercase();
    ["line_", "samp_", "\"rpc\"", "row_num"].iter().any(|word| text.contains(word))
}
