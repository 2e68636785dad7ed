//! One cell of ground: the scene cropped to it is matched and adjusted, and some of its tracks are kept.

use super::adjuster::Adjuster;
use super::cell_grid::{CellGrid, GroundCell};
use super::cell_tracks::{CellObservation, CellResult, CellTrack};
use super::error::BundleError;
use super::network::Estimate;
use super::options::BundleOptions;
use super::stages::{Extent, find_keypoints, match_and_adjust};
use super::track_choice::{Candidate, choose};
use crate::progress::Progress;
use crate::scene::{Scene, SceneError};

/// Largest number of tracks that a cell keeps. Three hundred determine the cameras; training takes the ground between which it
/// searches the surface from the points, and needs many more.
const MOST_TRACKS: usize = 2000;
/// Largest number of tracks of all cells, so that the memory of the adjustment is limited; a cell keeps [`FEWEST_TRACKS`] in
/// any case.
const MOST_TRACKS_OF_ALL: usize = 200_000;
const FEWEST_TRACKS: usize = 300;

/// Number of tracks that each of so many cells may keep.
pub(super) fn most_tracks(cells: usize) -> usize {
    (MOST_TRACKS_OF_ALL / cells.max(1)).clamp(FEWEST_TRACKS, MOST_TRACKS)
}

/// Matches and adjusts the views of a cell, and chooses tracks.
///
/// # Errors
/// [`BundleError`] where the reason is not the cell: an image cannot be read, the caller asked to stop.
pub(super) fn tracks_of_cell(
    scene: &Scene,
    grid: &CellGrid,
    cell: &GroundCell,
    heights: (f64, f64),
    fixed: bool,
    progress: &dyn Progress,
) -> Result<CellResult, BundleError> {
    let found = || -> Result<Vec<CellTrack>, BundleError> {
        let part = grid.crop(scene, cell, heights)?;
        part.require_views(2)?;
        let options = BundleOptions { fixed, ..BundleOptions::default() };
        let keypoints = find_keypoints(&part, Extent::Cell, None, progress)?;
        let (adjuster, estimate) =
            match_and_adjust(&part, &keypoints, heights, &options, Extent::Cell, progress)?;
        Ok(chosen(scene, grid, cell, &adjuster, &estimate))
    };
    match found() {
        Ok(tracks) if tracks.is_empty() => Ok(Err("it has no tie points".into())),
        Ok(tracks) => Ok(Ok(tracks)),
        Err(e) if is_of_cell(&e) => Ok(Err(e.to_string())),
        Err(e) => Err(e),
    }
}

/// Whether an error says that a cell cannot be matched, which does not keep others from being.
fn is_of_cell(error: &BundleError) -> bool {
    matches!(
        error,
        BundleError::TooFewViews { .. }
            | BundleError::NotConnected { .. }
            | BundleError::NoTracks { .. }
            | BundleError::NoBaseline { .. }
            | BundleError::NoOverlap { .. }
            | BundleError::TooOblique { .. }
            | BundleError::Solver { .. }
            | BundleError::Refit { .. }
            | BundleError::Scene(SceneError::TooFewViews { .. } | SceneError::AreaNotSeen { .. })
    )
}

/// The tracks of an adjusted cell that are kept: points within the cell, in pixels of the whole images.
fn chosen(
    scene: &Scene,
    grid: &CellGrid,
    cell: &GroundCell,
    adjuster: &Adjuster,
    estimate: &Estimate,
) -> Vec<CellTrack> {
    let block = adjuster.network.block();
    let mut inside = Vec::new();
    let mut candidates = Vec::new();
    for (track, point) in estimate.tracks.iter().zip(&estimate.points) {
        let position = grid.position_in(cell, block.geodetic(*point));
        if !position.iter().all(|p| (0.0..1.0).contains(p)) {
            continue;
        }
        let seen = &track.observations;
        let squares = seen.iter().map(|m| block.distance(m, &estimate.corrections[m.view], *point).powi(2));
        let rms_px = (squares.sum::<f64>() / seen.len() as f64).sqrt();
        candidates.push(Candidate {
            position,
            views: seen.iter().map(|m| (m.view, m.weight)).collect(),
            rms_px,
        });
        inside.push(track);
    }
    // Indices of the cell's views in the scene.
    let in_scene: Vec<u32> = adjuster
        .views
        .iter()
        .filter_map(|used| scene.views.iter().position(|v| v.name == used.view.name))
        .map(|i| i as u32)
        .collect();
    let kept = choose(&candidates, most_tracks(grid.cells.len())).into_iter().map(|i| CellTrack {
        gray: inside[i].gray,
        observations: inside[i]
            .observations
            .iter()
            .map(|m| {
                let px = adjuster.views[m.view].view.px_of_whole(m.px);
                CellObservation { view: in_scene[m.view], px: [px.col, px.row], weight: m.weight }
            })
            .collect(),
    });
    kept.collect()
}
