//! Scene layout 1: a folder of images, each with its RPC in the file (TIFF tag, NITF segment) or beside it.
//!
//! As in GDAL, an RPC beside an image has precedence over one in it ([`super::RPC_ORDER`] lists the order). RPCs that differ
//! by more than 0.1 px give a warning. The lists `test.txt` and `train.txt` ([`Roles`]) lie beside the images.

use super::files::{has_extension, stem};
use super::found::no_images;
use super::roles::Roles;
use super::sidecar::Sidecars;
use super::source::{files_in, images_in, is_companion, no_rpc, other_rasters, view};
use super::{SceneError, View};
use crate::io::ImageFile;
use std::path::{Path, PathBuf};

/// Reads the views of a folder.
pub(super) fn read(
    folder: &Path,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>, SceneError> {
    let mut images = images_in(folder)?;
    let listing = files_in(folder)?;
    for other in other_rasters(&listing) {
        // `NAME.png` beside `NAME.tif` is a preview.
        if images.iter().any(|i| stem(i) == stem(other)) {
            continue;
        }
        match ImageFile::open(other) {
            Ok(file) if !file.metadata_domain("RPC").is_empty() => images.push(other.clone()),
            _ => warnings
                .push(format!("`{}` is left out, because it holds no image with an RPC", other.display())),
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
        (None, true) => return Err(no_images(folder)),
        (Some(image), true) => return Err(no_rpc(image)),
        _ => {}
    }
    for image in without {
        // A map among sensor images, such as a DEM or an orthophoto, is not a view.
        if !ImageFile::open(image)?.is_map() {
            return Err(no_rpc(image));
        }
        warnings.push(format!("`{}` is left out, because it is a map without an RPC", image.display()));
    }
    for companion in listing.iter().filter(|p| is_companion(p) && has_pixels(p)) {
        warnings.push(take_companion(companion, &mut views));
    }
    let roles = Roles::read(&without_sidecars(listing, &images))?;
    let unknown = roles.assign(&mut views, &images);
    if !unknown.is_empty() {
        let (folder, unknown) = (folder.display(), unknown.join(", "));
        warnings.push(format!("`{folder}` lists views that do not exist: {unknown}"));
    }
    Ok(views)
}

/// The files that are not named like an image: `test.txt` beside `test.tif` is its RPC and no list.
fn without_sidecars(mut listing: Vec<PathBuf>, images: &[PathBuf]) -> Vec<PathBuf> {
    listing.retain(|file| !images.iter().any(|image| stem(image) == stem(file)));
    listing
}

/// Whether a companion file is a raster, by its name.
fn has_pixels(path: &Path) -> bool {
    has_extension(path, &["tif", "tiff"])
}

/// Sets a Planet `udm2`, whose first band is 1 where the image is clear, as the mask of its image. Returns a sentence that
/// says what was done with the file.
fn take_companion(companion: &Path, views: &mut [View]) -> String {
    let (path, name) = (companion.display(), stem(companion).to_lowercase());
    let left_out = format!("`{path}` is left out, because it describes another image");
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
        format!("`{path}` is used as the mask of {}", masked.join(", "))
    }
}
