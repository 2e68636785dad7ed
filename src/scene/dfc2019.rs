//! Scene layout 2, that of sat-NeRF and DFC2019: a folder `images/`, and beside it one or more folders of RPC files (JSON
//! or text).
//!
//! The lists `test.txt` and `train.txt` ([`Roles`]) lie in the folder of RPC files and hold names `NAME.json`.

use super::files::{has_extension, stem};
use super::roles::Roles;
use super::sidecar::{Sidecars, camera_of};
use super::source::{files_in, images_in, view};
use super::{SceneError, View};
use crate::io::vsi;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Folder of the ground truth; its cameras are used only if the user chooses them by name.
const TRUTH: &str = "truth";

/// Names of the folders beside `images/` that hold RPC files of its images.
pub(super) fn rpc_folders(scene: &Path) -> Result<Vec<String>, SceneError> {
    let images = images_in(&scene.join("images"))?;
    let mut found = Vec::new();
    for folder in files_in(scene)?.into_iter().filter(|p| vsi::is_dir(p)) {
        let name = folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        if name == "images" || name == TRUTH {
            continue;
        }
        // A folder that may not be read is not a candidate. If the user chooses it by name, reading it gives an error.
        let listing = files_in(&folder).unwrap_or_default();
        if images.iter().any(|i| camera_of(&stem(i), &listing).is_some()) {
            found.push(name);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads the views that have an RPC file in the folder `rpcs` of the scene.
pub(super) fn read(
    scene: &Path,
    rpcs: &str,
    trust_rpc: bool,
    warnings: &mut Vec<String>,
) -> Result<Vec<View>, SceneError> {
    let folder = scene.join(rpcs);
    let listing = files_in(&folder)?;
    let images = images_in(&scene.join("images"))?;
    check_images_exist(&images, &listing, &scene.join("images"))?;
    let roles = Roles::read(&listing)?;
    let (mut views, mut without) = (Vec::new(), Vec::new());
    for image in &images {
        let name = stem(image);
        let Some(file) = camera_of(&name, &listing) else {
            without.push(name);
            continue;
        };
        // The RPC in the image is not compared: it is expected to differ from a corrected one.
        if let Some(mut view) = view(image, &Sidecars::with_camera(file, image, &[]), trust_rpc, warnings)? {
            view.rpc_source = format!("{rpcs}/{}", view.rpc_source);
            views.push(view);
        }
    }
    if !without.is_empty() {
        warnings.push(format!("left out, because `{rpcs}` has no RPC for them: {}", without.join(", ")));
    }
    let unknown = roles.assign(&mut views, &images);
    if !unknown.is_empty() {
        warnings.push(format!("`{rpcs}` lists views that do not exist: {}", unknown.join(", ")));
    }
    Ok(views)
}

/// Checks that every RPC file has its image; a missing image means that the scene was copied incompletely.
fn check_images_exist(images: &[PathBuf], listing: &[PathBuf], folder: &Path) -> Result<(), SceneError> {
    let names: BTreeSet<String> = images.iter().map(|i| stem(i).to_lowercase()).collect();
    let is_json = |p: &&PathBuf| has_extension(p, &["json"]);
    for rpc in listing.iter().filter(is_json) {
        let name = stem(rpc);
        let lower = name.to_lowercase();
        if names.contains(&lower) || names.contains(lower.trim_end_matches("_rpc")) {
            continue;
        }
        // Other JSON files, such as settings and reports, may be in the folder too.
        if let Ok(file) = crate::rpc::formats::read(rpc) {
            let image = file.tags.image.unwrap_or_else(|| format!("{name}.tif"));
            return Err(SceneError::NoImageForRpc { rpc: rpc.clone(), image: folder.join(image) });
        }
    }
    Ok(())
}
