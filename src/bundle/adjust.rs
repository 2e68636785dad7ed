//! Bundle adjustment of a scene: all at once if it is small, else by cells of the ground.

use super::cell_grid::CellGrid;
use super::error::BundleError;
use super::options::BundleOptions;
use super::output::Adjustment;
use super::stages::{Extent, find_keypoints, match_and_adjust};
use super::whole_scene::adjust_by_cells;
use crate::progress::{Event, Progress};
use crate::run_files::MATCHING;
use crate::scene::Scene;

/// Largest side of a cell, metres.
const CELL_M: f64 = 1000.0;
/// Scenes with an image of more pixels are adjusted by cells in any case, because cells read of the image only what shows
/// the common ground.
const LARGE_PX: usize = 50_000_000;

/// Corrects the RPCs of a scene by bundle adjustment.
///
/// Views without enough keypoints, and views that contradict the others, are left out, with a warning each; the remaining
/// views are then adjusted again.
///
/// A scene whose ground is larger than one cell (see [`BundleOptions::cell_m`]) is matched cell by cell, and the tie points
/// of all cells are adjusted at once, with the memory of one cell. Cells without tie points (water, clouds) are skipped with a
/// warning.
///
/// # Errors
/// [`BundleError`]: too few views, no common ground, matches that do not connect the views, ground control of
/// images that are not there, a request to stop.
pub fn adjust(
    scene: &Scene,
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<Adjustment, BundleError> {
    scene.require_views(2)?;
    if options.height_range.is_none() {
        scene.require_shared_heights()?;
    }
    let heights = options.height_range.unwrap_or_else(|| scene.height_range());
    // A comparison that NaN fails too.
    if !matches!(heights.0.partial_cmp(&heights.1), Some(std::cmp::Ordering::Less)) {
        return Err(BundleError::Heights { low_m: heights.0, high_m: heights.1 });
    }
    let overlap = scene.require_shared_ground(heights)?;
    let grid = CellGrid::of(scene, &overlap, options.cell_m.unwrap_or(CELL_M))?;
    let is_large = scene.views.iter().any(|v| v.width * v.height > LARGE_PX);
    if grid.is_cut || (is_large && !grid.cells.is_empty()) {
        return adjust_by_cells(scene, &grid, heights, options, progress);
    }
    let store = options.store.as_ref().map(|store| store.within(MATCHING));
    progress.event(Event::Resumable(store.is_some()));
    let keypoints = find_keypoints(scene, Extent::Scene, store.as_ref(), progress)?;
    let (adjuster, estimate) =
        match_and_adjust(scene, &keypoints, heights, options, Extent::Scene, progress)?;
    progress.event(Event::Resumable(false));
    adjuster.result(&estimate, options)
}
