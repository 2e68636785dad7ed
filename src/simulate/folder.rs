//! The folder of a scene: created, or cleared of an earlier simulation.

use super::appearance::{LIST, PICTURES};
use super::error::SimulateError;
use super::export::{TEST_LIST, TRAIN_LIST};
use super::perspective::{DESCRIPTION, DISPARITIES, FRAMES, IMAGES, MAPS, MESH, MODEL, frame_files};
use super::terrain::TRUTH_NAMES;
use crate::io::WriteError;
use std::path::{Path, PathBuf};

/// Folder of the truth of appearance in `truth/`.
pub(super) const APPEARANCE: &str = "appearance";

/// Creates the folder, or removes the files of an earlier simulation from it; other files are kept.
pub(super) fn prepare(out: &Path, overwrite: bool) -> Result<(), SimulateError> {
    let failed = |path: &Path, cause: std::io::Error| SimulateError::Write(WriteError::new(path, cause));
    std::fs::create_dir_all(out).map_err(|e| failed(out, e))?;
    let entries = std::fs::read_dir(out).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|e| failed(out, e))?;
    if entries.is_empty() {
        return Ok(());
    }
    if !overwrite {
        return Err(SimulateError::NotEmpty { path: out.into() });
    }
    let files = of_satellite_images(out).into_iter().chain(of_photographs(out));
    for path in files.collect::<Vec<_>>() {
        std::fs::remove_file(&path).map_err(|e| failed(&path, e))?;
    }
    let appearance = format!("truth/{APPEARANCE}");
    let folders = [appearance.as_str(), "truth/rpcs", IMAGES, MODEL, "sparse"].into_iter();
    for folder in folders.chain(MAPS).chain(["priors", FRAMES]) {
        // A folder stays if it holds other files, which is no failure.
        let _ = std::fs::remove_dir(out.join(folder));
    }
    Ok(())
}

/// The files of satellite images, which another number of views or other options might not replace.
fn of_satellite_images(out: &Path) -> Vec<PathBuf> {
    let is_view = |name: &str, ends: &[&str]| {
        ["VIEW_", "TEST_"].iter().any(|start| name.starts_with(start))
            && ends.iter().any(|e| name.ends_with(e))
    };
    let appearance = out.join("truth").join(APPEARANCE);
    let mut found = Vec::new();
    for (folder, ends) in [
        (out.to_path_buf(), &[".tif"][..]),
        (out.join("truth/rpcs"), &[".json"]),
        (appearance.clone(), &PICTURES),
    ] {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        found.extend(entries.filter(|e| is_view(&e.file_name().to_string_lossy(), ends)).map(|e| e.path()));
    }
    let truth = TRUTH_NAMES
        .into_iter()
        .flat_map(|name| ["DSM", "DTM", "CLS"].map(|what| out.join(format!("truth/{name}_{what}.tif"))));
    let lists = [out.join(TEST_LIST), out.join("truth/shifts.json"), appearance.join(LIST)];
    found.extend(truth.chain(lists).filter(|path| path.exists()));
    found
}

/// The files of photographs. There are none without exact depths: a COLMAP project of the user may have files of the same
/// names.
fn of_photographs(out: &Path) -> Vec<PathBuf> {
    if !out.join(MAPS[0]).exists() {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (folder, end) in [(IMAGES, ".png")].into_iter().chain(MAPS.map(|folder| (folder, ".npy"))) {
        let entries = std::fs::read_dir(out.join(folder)).into_iter().flatten().flatten();
        let numbered = entries.filter(|e| is_numbered(&e.file_name().to_string_lossy(), end));
        found.extend(numbered.map(|e| e.path()));
    }
    let model = ["cameras.txt", "images.txt", "points3D.txt"].map(|file| out.join(MODEL).join(file));
    let single = [MESH, DISPARITIES, TRAIN_LIST].map(|file| out.join(file));
    let description = [out.join(MAPS[2]).join(DESCRIPTION)];
    let files = model.into_iter().chain(single).chain(description);
    found.extend(files.filter(|path| path.exists()));
    found.extend(frame_files(out));
    found
}

/// Whether a file is called as those of photographs are: four digits and an end.
fn is_numbered(name: &str, end: &str) -> bool {
    name.strip_suffix(end).is_some_and(|n| n.len() == 4 && n.bytes().all(|b| b.is_ascii_digit()))
}
