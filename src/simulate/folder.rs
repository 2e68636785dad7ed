//! The folder of a scene: created, or cleared of an earlier simulation.

use super::appearance::{LIST, PICTURES};
use super::error::SimulateError;
use super::export::TEST_LIST;
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
    // The folder stays if it holds other files, which is no failure.
    let _ = std::fs::remove_dir(out.join("truth").join(APPEARANCE));
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
    found.extend([out.join(TEST_LIST), appearance.join(LIST)].into_iter().filter(|path| path.exists()));
    found
}
