//! Files beside a scene that look as if they belonged to it, and are not read.

use super::draft::Drafts;
use crate::io::vsi;
use std::path::{Path, PathBuf};

/// Names of folders that hold a file for each image, and what can be done with them.
const FOLDERS: [(&str, &str); 7] = [
    ("masks", "no image has its mask there: masks are called NAME.png or NAME.EXT.png"),
    ("mask", "masks are read from a folder `masks`, or from `mask_path` in a transforms.json"),
    ("depths", "--depth-prior takes a folder of depth maps"),
    ("depth", "--depth-prior takes a folder of depth maps"),
    ("normals", "--normal-prior takes a folder of normals"),
    ("normal", "--normal-prior takes a folder of normals"),
    ("segmentations", "segmentations are not read"),
];

/// What lies in the folder of a local scene and is not among the files of the scene, with a reason each.
pub(super) fn unused_companions(scene: &Path, drafts: &Drafts) -> Vec<(String, String)> {
    let folder = if vsi::is_dir(scene) { scene } else { scene.parent().unwrap_or(Path::new("")) };
    if vsi::is_remote(folder) {
        return Vec::new();
    }
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let of_views = drafts.views.iter().flat_map(|view| {
        let masks = view.masks.iter().map(|mask| &mask.path);
        [&view.image].into_iter().chain(view.depth.iter().map(|depth| &depth.path)).chain(masks)
    });
    let used: Vec<&PathBuf> = of_views.chain(&drafts.sources).collect();
    let mut entries = vsi::list(folder).unwrap_or_default();
    entries.sort();
    let unused = entries.into_iter().filter_map(|path| {
        let name = path.file_name()?.to_string_lossy().into_owned();
        let reason = reason_of(&name, &path)?;
        let is_used = used.iter().any(|file| is_same_or_inside(file, &path, &name));
        (!is_used).then(|| (name, reason.to_owned()))
    });
    unused.collect()
}

/// What can be said of an entry of a scene's folder by its name; none if it does not look like a part of the scene.
fn reason_of(name: &str, path: &Path) -> Option<&'static str> {
    if let Some((_, reason)) = FOLDERS.iter().find(|(folder, _)| *folder == name) {
        return vsi::is_dir(path).then_some(reason);
    }
    let is = |start: &str, end: &str| name.starts_with(start) && name.ends_with(end);
    if is("transforms", ".json") {
        Some("another file of cameras is read")
    } else if is("", ".ply") {
        Some("no file of the scene names it as its points")
    } else {
        None
    }
}

/// Whether a file is an entry of a folder, or lies in it. Paths may name the folder in different ways.
fn is_same_or_inside(file: &Path, entry: &Path, name: &str) -> bool {
    if file.starts_with(entry) {
        return true;
    }
    let mut has_name = file.ancestors().filter(|part| part.file_name().is_some_and(|n| n == name));
    has_name.any(|part| matches!((part.canonicalize(), entry.canonicalize()), (Ok(a), Ok(b)) if a == b))
}
