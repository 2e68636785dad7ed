//! Layout 1: a folder of images, each with its RPC inside (tag, NITF) or beside it.
//!
//! As in GDAL, what lies beside an image wins over what is in it ([`super::RPC_ORDER`] has the order). Where two
//! differ by more than 0.1 px a warning says so.

use super::sidecar::Sidecars;
use super::source::{files_in, images_in, no_rpc, stem, view};
use super::{SceneError, View};
use crate::raster::ImageFile;
use std::path::Path;

/// Reads the views of a folder.
pub(super) fn read(folder: &Path, warnings: &mut Vec<String>) -> Result<Vec<View>, SceneError> {
    let images = images_in(folder)?;
    let listing = files_in(folder)?;
    let (mut views, mut without) = (Vec::new(), Vec::new());
    for image in &images {
        match view(image, &Sidecars::of(image, &listing), warnings)? {
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
        if let Some(note) = usable_data_mask(image, &mut views)? {
            warnings.push(note);
            continue;
        }
        // A map among sensor images (a DEM, an orthophoto) is there for another purpose.
        if !ImageFile::open(image)?.is_map() {
            return Err(no_rpc(image));
        }
        warnings.push(format!("`{}` is a map without an RPC, it is left out", image.display()));
    }
    Ok(views)
}

/// Takes an image without a camera for the mask that Planet delivers beside its scenes (`ITEM_udm2.tif`, its first band 0
/// where a pixel is not clear), and gives it to the images of its item; says so. None if it is another image.
fn usable_data_mask(image: &Path, views: &mut [View]) -> Result<Option<String>, SceneError> {
    let name = stem(image);
    let Some(product) = name.strip_suffix("_udm2") else { return Ok(None) };
    let mut masked = Vec::new();
    for view in views.iter_mut().filter(|v| v.mask.is_none() && v.name.starts_with(product)) {
        if ImageFile::open(image)?.size() == (view.width, view.height) {
            view.set_mask(image.into())?;
            masked.push(view.name.as_str());
        }
    }
    let of =
        if masked.is_empty() { "no image of its size and name is there".into() } else { masked.join(", ") };
    Ok(Some(format!("`{}` is no image but tells which pixels are clear: {of}", image.display())))
}
