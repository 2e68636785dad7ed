//! Scene layout 2, that of sat-NeRF and DFC2019: a folder `images/`, and beside it one or more folders of RPC files (JSON
//! or text).
//!
//! A file `test.txt` in a folder of RPC files lists views that are not trained on, one `NAME.json` per line. If there is a
//! file `train.txt`, only the views that it lists are trained on.

use super::files::{read_text, stem};
use super::sidecar::{Sidecars, camera_of};
use super::source::{files_in, images_in, view};
use super::{Role, SceneError, View};
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
    let roles = Roles::read(&folder)?;
    let (mut views, mut without) = (Vec::new(), Vec::new());
    for image in &images {
        let name = stem(image);
        let Some(file) = camera_of(&name, &listing) else {
            without.push(name);
            continue;
        };
        // The RPC in the image is not compared: it is expected to differ from a corrected one.
        if let Some(mut view) = view(image, &Sidecars::with_camera(file, image, &[]), trust_rpc, warnings)? {
            view.role = roles.of(&name);
            view.rpc_source = format!("{rpcs}/{}", view.rpc_source);
            views.push(view);
        }
    }
    if !without.is_empty() {
        warnings.push(format!("left out, because `{rpcs}` has no RPC for them: {}", without.join(", ")));
    }
    let names: BTreeSet<&str> = images.iter().filter_map(|i| i.file_stem()?.to_str()).collect();
    let unknown: Vec<&str> = roles.listed().filter(|n| !names.contains(n)).collect();
    if !unknown.is_empty() {
        warnings.push(format!("`{rpcs}` lists views that do not exist: {}", unknown.join(", ")));
    }
    Ok(views)
}

/// Checks that every RPC file has its image; a missing image means that the scene was copied incompletely.
fn check_images_exist(images: &[PathBuf], listing: &[PathBuf], folder: &Path) -> Result<(), SceneError> {
    let names: BTreeSet<String> = images.iter().map(|i| stem(i).to_lowercase()).collect();
    let is_json = |p: &&PathBuf| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
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

/// Content of `train.txt` and `test.txt`.
struct Roles {
    train: Option<BTreeSet<String>>,
    test: BTreeSet<String>,
}

impl Roles {
    fn read(folder: &Path) -> Result<Self, SceneError> {
        Ok(Self {
            train: names_in(&folder.join("train.txt"))?,
            test: names_in(&folder.join("test.txt"))?.unwrap_or_default(),
        })
    }

    fn of(&self, name: &str) -> Role {
        let trained = self.train.as_ref().is_none_or(|t| t.contains(name));
        if trained && !self.test.contains(name) { Role::Train } else { Role::Test }
    }

    fn listed(&self) -> impl Iterator<Item = &str> {
        self.train.iter().flatten().chain(&self.test).map(String::as_str)
    }
}

/// Names of the views in a list; `None` if the file does not exist.
fn names_in(list: &Path) -> Result<Option<BTreeSet<String>>, SceneError> {
    if !vsi::exists(list) {
        return Ok(None);
    }
    let text = read_text(list)?;
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
    // Names may contain dots, so that only known extensions are removed.
    let bare = |l: &str| {
        let known = [".json", ".tif", ".tiff"];
        known.iter().find_map(|e| l.strip_suffix(e)).unwrap_or(l).to_owned()
    };
    Ok(Some(lines.map(bare).collect()))
}
