//! Layout 1: a folder of images, each with its RPC inside (tag, NITF) or beside it.
//!
//! As in GDAL, what lies beside an image wins over what is in it ([`super::RPC_ORDER`] has the order). Where two
//! differ by more than 0.1 px a warning says so.

use super::files::stem;
use super::sidecar::Sidecars;
use super::source::{files_in, images_in, is_companion, no_rpc, other_rasters, view};
use super::{SceneError, View};
use crate::io::ImageFile;
use std::path::Path;

/// Reads the views of a folder.
pub(super) fn read(
    folder: &Path,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>, SceneError> {
    let mut images = images_in(folder)?;
    let listing = files_in(folder)?;
    for other in other_rasters(&listing) {
        // A picture of an image (`NAME.png` beside `NAME.tif`) is for looking at.
        if images.iter().any(|i| stem(i) == stem(other)) {
            continue;
        }
        match ImageFile::open(other) {
            Ok(file) if !file.metadata_domain("RPC").is_empty() => images.push(other.clone()),
            _ => warnings.push(format!("`{}` holds no image with an RPC, it is left out", other.display())),
        }
    }
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
    for companion in listing.iter().filter(|p| is_companion(p) && has_pixels(p)) {
        warnings.push(take_companion(companion, &mut views));
    }
    Ok(views)
}

/// Whether a companion's name is that of a raster.
fn has_pixels(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("tif") || e.eq_ignore_ascii_case("tiff"))
}

/// Takes a Planet `udm2`, whose first band is 1 where the image is clear, as the mask of its image; in words.
fn take_companion(companion: &Path, views: &mut [View]) -> String {
    let (path, name) = (companion.display(), stem(companion).to_lowercase());
    let left_out = format!("`{path}` tells of another image, it is left out");
    let Some(scene) = name.strip_suffix("_udm2") else { return left_out };
    let mut masked = Vec::new();
    for view in views.iter_mut().filter(|v| v.name.to_lowercase().starts_with(scene)) {
        if view.set_mask(companion.to_owned()).is_ok() {
            masked.push(view.name.as_str());
        }
    }
    if masked.is_empty() {
        left_out
    } else {
        format!("`{path}` is taken as the mask of {}", masked.join(", "))
    }
}
