//! The folder of a scene: created, or cleared of an earlier simulation.

use super::TRUTH_NAME;
use super::appearance::{LIST, PICTURES};
use super::error::SimulateError;
use super::export::{TEST_LIST, TRAIN_LIST};
use super::perspective::{DESCRIPTION, DISPARITIES, IMAGES, MAPS, MESH, MODEL};
use std::path::{Path, PathBuf};

/// Folder of the truth of appearance in `truth/`.
pub(super) const APPEARANCE: &str = "appearance";

/// Creates the folder, or removes the files of an earlier simulation from it; other files are kept.
pub(super) fn prepare(out: &Path, overwrite: bool) -> Result<(), SimulateError> {
    let failed = |path: &Path, cause: std::io::Error| SimulateError::Folder { path: path.into(), cause };
    std::fs::create_dir_all(out).map_err(|e| failed(out, e))?;
    let entries = std::fs::read_dir(out).and_then(Iterator::collect::<Result<Vec<_>, _>>);
    let entries = entries.map_err(|e| failed(out, e))?;
    if entries.is_empty() {
        return Ok(());
    }
    if !overwrite {
        return Err(SimulateError::NotEmpty { path: out.into() });
    }
    for path in of_earlier_simulation(out) {
        std::fs::remove_file(&path).map_err(|e| failed(&path, e))?;
    }
    // A folder stays if it holds other files, which is no failure.
    let of_photographs = [IMAGES, MODEL, "sparse"].into_iter().chain(MAPS).chain(["priors"]);
    for folder in
        of_photographs.map(Into::into).chain([Path::new("truth").join(APPEARANCE), "truth/rpcs".into()])
    {
        let folder: PathBuf = folder;
        let _ = std::fs::remove_dir(out.join(folder));
    }
    Ok(())
}

/// The files that another number of views or other options might not replace.
fn of_earlier_simulation(out: &Path) -> Vec<PathBuf> {
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
    for (folder, end) in [(IMAGES, ".png")].into_iter().chain(MAPS.map(|folder| (folder, ".npy"))) {
        let entries = std::fs::read_dir(out.join(folder)).into_iter().flatten().flatten();
        found
            .extend(entries.filter(|e| is_numbered(&e.file_name().to_string_lossy(), end)).map(|e| e.path()));
    }
    let model = Path::new(MODEL);
    let single = ["cameras.txt", "images.txt", "points3D.txt"].map(|file| model.join(file)).into_iter();
    let single =
        single.chain([TEST_LIST, TRAIN_LIST, MESH, DISPARITIES, "truth/shifts.json"].map(Into::into));
    let single = single.chain(["DSM", "CLS"].map(|what| format!("truth/{TRUTH_NAME}_{what}.tif").into()));
    let single = single.chain([Path::new(MAPS[2]).join(DESCRIPTION)]).map(|file| out.join(file));
    found.extend(single.chain([appearance.join(LIST)]).filter(|path| path.exists()));
    found
}

/// Whether a file is called as those of photographs are: four digits and an end.
fn is_numbered(name: &str, end: &str) -> bool {
    name.strip_suffix(end).is_some_and(|n| n.len() == 4 && n.bytes().all(|b| b.is_ascii_digit()))
}
