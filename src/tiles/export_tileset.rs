//! All tiles of a scene as 3D Tiles.

use super::{Plan, TilesError, tile_folder};
use crate::pipeline::{ExportedTileset, TilesetPart, export_tileset};
use crate::progress::{Event, Progress};
use crate::run_files::{PLAN, SPLATS};
use std::path::Path;

/// Exports the splats of a run as 3D Tiles: see [`export_tileset`]. Of a scene of several tiles each brings the splats on its
/// core; those that are not trained are left out, with a warning.
///
/// # Errors
/// [`TilesError`]: as [`export_tileset`], and if the plan is damaged.
pub fn export_scene_tileset(
    run: &Path,
    folder: &Path,
    copyright: Option<&str>,
    overwrite: bool,
    progress: &dyn Progress,
) -> Result<ExportedTileset, TilesError> {
    let mut parts = vec![TilesetPart::whole(run)];
    if run.join(PLAN).exists() {
        parts.clear();
        for tile in Plan::read(run)?.tiles {
            let its = tile_folder(run, &tile.id);
            if its.join(SPLATS).exists() {
                parts.push(TilesetPart { run: its, name: format!("{}-", tile.id), core: Some(tile.core) });
            } else {
                progress.event(Event::Warning(format!("tile `{}` has no splats and is left out", tile.id)));
            }
        }
    }
    Ok(export_tileset(&parts, folder, copyright, overwrite, progress)?)
}
