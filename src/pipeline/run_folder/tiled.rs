//! Runs of several tiles, and their tiles: which commands work in which of these folders.

use super::super::PipelineError;
use crate::run_files::{DONE, PLAN, SPLATS, TILES};
use std::path::{Path, PathBuf};

/// An error if a run is cut into tiles, for commands that work on one area: each tile is a run of its own.
pub fn require_one_area(run: &Path) -> Result<(), PipelineError> {
    if !run.join(PLAN).exists() {
        return Ok(());
    }
    let tiles = std::fs::read_dir(run.join(TILES)).into_iter().flatten().flatten().map(|tile| tile.path());
    let mut trained: Vec<PathBuf> = tiles.filter(|tile| tile.join(SPLATS).exists()).collect();
    trained.sort();
    let example = trained.first().cloned().unwrap_or_else(|| run.join(TILES).join("ID"));
    Err(PipelineError::OfTiles { run: run.into(), example })
}

/// The run that a folder is a tile of.
fn run_of_tile(folder: &Path) -> Option<PathBuf> {
    let folder = folder.canonicalize().ok()?;
    let tiles = folder.parent().filter(|parent| parent.ends_with(TILES))?;
    let run = tiles.parent()?;
    run.join(PLAN).exists().then(|| run.into())
}

/// An error if a folder is a tile of a plan, for commands that would change what the plan says of it.
pub fn require_no_tile(folder: &Path) -> Result<(), PipelineError> {
    match run_of_tile(folder) {
        Some(run) => Err(PipelineError::Tile { folder: folder.into(), run }),
        None => Ok(()),
    }
}

/// As [`require_no_tile`], but a tile that is done may get more products, unless its files were to be replaced.
pub fn require_own_tile(folder: &Path, overwrite: bool) -> Result<(), PipelineError> {
    if !overwrite && folder.join(DONE).exists() { Ok(()) } else { require_no_tile(folder) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_of_tiles_names_a_tile_and_a_tile_its_run() {
        let folder = tempfile::tempdir().unwrap();
        let (run, tile) = (folder.path().join("run"), folder.path().join("run/tiles/x001_y000"));
        std::fs::create_dir_all(&tile).unwrap();
        for path in [&run, &tile] {
            assert!(require_one_area(path).is_ok() && require_no_tile(path).is_ok());
        }
        std::fs::write(run.join(PLAN), "{}").unwrap();
        let refusal = |of: Result<(), PipelineError>| of.unwrap_err().to_string();
        assert!(refusal(require_one_area(&run)).contains("several tiles"));
        assert!(require_no_tile(&run).is_ok() && require_one_area(&tile).is_ok());
        assert!(refusal(require_no_tile(&tile)).contains("is a tile"));
        assert!(require_own_tile(&tile, false).is_err(), "it is not done");
        std::fs::write(tile.join(DONE), "{}").unwrap();
        assert!(require_own_tile(&tile, false).is_ok() && require_own_tile(&tile, true).is_err());
    }
}
