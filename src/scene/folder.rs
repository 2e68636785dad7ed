//! Layout 1: a folder of images, each with its RPC inside (tag, NITF) or beside it.
//!
//! As in GDAL, what lies beside an image wins over what is in it ([`super::RPC_ORDER`] has the order). Where two
//! differ by more than 0.1 px a warning says so.

use super::sidecar::Sidecars;
use super::source::{files_in, images_in, no_rpc, view};
use super::{SceneError, View};
use crate::raster::ImageFile;
use std::path::Path;

/// Reads the views of a folder.
pub(super) fn read(folder: &Path, trust_rpc: bool, warnings: &mut Vec<String>) -> Result<Vec<View>, SceneError> {
    let images = images_in(folder)?;
    let listing = files_in(folder)?;
    let (mut views, mut without) = (Vec::new(), Vec::new());
    for image in &images {
        match view(image, &Sidecars::of(image, &listing), trust_rpc, warnings)? {
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
        if !ImageFile::open(image)?.is_map() {
            return Err(no_rpc(image));
        }
        warnings.push(format!("`{}` is a map without an RPC, it is left out", image.display()));
    }
    Ok(views)
}
