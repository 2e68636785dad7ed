//! Adjustment of a large scene: tie points are found cell by cell of the ground, and adjusted all at once.

use super::adjuster::{Adjuster, Outcome, attempt, has_majority, warn_left_out};
use super::cell::{most_tracks, tracks_of_cell};
use super::cell_grid::{CellGrid, GroundCell};
use super::cell_tracks::{CellResult, CellTrack};
use super::duplicates::merge_duplicates;
use super::error::{BundleError, height_hint};
use super::network::{Estimate, LOSS_SCALES_PX};
use super::options::BundleOptions;
use super::output::Adjustment;
use super::problem::{Observation, Track};
use super::report::{CellReport, LeftOut};
use super::tie_point_refinement::MIN_PATCH_LIMIT_PX;
use super::tracks;
use crate::checkpoint::PartStore;
use crate::frame::Pixel;
use crate::progress::{Event, Progress};
use crate::scene::Scene;

/// A cell with a larger root mean square reprojection error is named in a warning, pixels.
const WARN_RMS_PX: f64 = 0.5;

/// Folder of the tie points of cells.
const CELLS: &str = "cells";

/// Number of cells that a message lists.
const LISTED: usize = 5;

/// Finds the tie points of each cell, and adjusts those of all cells at once.
///
/// # Errors
/// [`BundleError`]; [`BundleError::NoCell`] if no cell has tie points.
pub(super) fn adjust_by_cells(
    scene: &Scene,
    grid: &CellGrid,
    heights: (f64, f64),
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<Adjustment, BundleError> {
    grid.require_tiled_images(scene, heights)?;
    let results = results_of_cells(scene, grid, heights, options, progress)?;
    let skipped: Vec<String> = grid
        .cells
        .iter()
        .zip(&results)
        .filter_map(|(cell, result)| Some(format!("{} ({})", cell.id, result.as_ref().err()?)))
        .collect();
    if skipped.len() == results.len() {
        let (reasons, hint) = (first_of(&skipped, "; "), height_hint(heights));
        return Err(BundleError::NoCell { cells: results.len(), reasons, hint });
    }
    if !skipped.is_empty() {
        progress.event(Event::Warning(format!(
            "{} of {} cells of the ground have no tie points: {}",
            skipped.len(),
            results.len(),
            first_of(&skipped, "; ")
        )));
    }
    let without = views_without_tracks(scene, &results);
    without.iter().for_each(|view| warn_left_out(progress, view));
    let (adjuster, estimate) = attempt(
        |mut left_out| {
            left_out.extend(without.iter().filter(|w| !left_out.contains(w)).cloned().collect::<Vec<_>>());
            Adjuster::new(scene, None, heights, left_out, progress)
        },
        |adjuster| adjuster.adjust_tracks(scene, &results, options),
    )?;
    let mut adjustment = adjuster.result(&estimate, options)?;
    adjustment.report.cells = reports(grid, &results, &adjuster, &estimate, options.fixed);
    let bad = adjustment.report.cells.iter().filter(|c| c.rms_px.is_some_and(|rms| rms > WARN_RMS_PX));
    let bad: Vec<String> =
        bad.map(|c| format!("{} ({:.2} px)", c.id, c.rms_px.unwrap_or_default())).collect();
    if !bad.is_empty() {
        progress.event(Event::Warning(format!(
            "the reprojection error is above {WARN_RMS_PX} px in cells of the ground: {}",
            first_of(&bad, ", ")
        )));
    }
    Ok(adjustment)
}

/// The first few of a list that may have hundreds, as text.
fn first_of(list: &[String], separator: &str) -> String {
    let shown = list[..list.len().min(LISTED)].join(separator);
    match list.len().saturating_sub(LISTED) {
        0 => shown,
        more => format!("{shown}{separator}and {more} more, which `cells` in ba/report.json lists"),
    }
}

/// The result of every cell, from its file if it is stored.
fn results_of_cells(
    scene: &Scene,
    grid: &CellGrid,
    heights: (f64, f64),
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<Vec<CellResult>, BundleError> {
    let store = options.store.as_ref().map(|store| store.within(CELLS));
    progress.event(Event::Resumable(store.is_some()));
    progress.event(Event::Started { stage: "matching cells", total: grid.cells.len() as u64 });
    let mut results = Vec::with_capacity(grid.cells.len());
    for (done, cell) in grid.cells.iter().enumerate() {
        progress.check()?;
        let made_from =
            format!("{:?}", (&cell.bounds, heights, options.fixed, most_tracks(grid.cells.len())));
        let of_cell = CellProgress { of_scene: progress, done: done as u64, cell };
        let result = PartStore::part(store.as_ref(), &cell.id, &made_from, || {
            tracks_of_cell(scene, grid, cell, heights, options.fixed, &of_cell)
        })?;
        results.push(result);
        progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
    }
    progress.event(Event::Finished);
    progress.check()?;
    if let Some(store) = &store {
        store.tell(progress);
    }
    progress.event(Event::Resumable(false));
    Ok(results)
}

/// Tells what is done in a cell as the status of the scene's cells. Warnings of a cell are not for the user: views that
/// are left out of one cell are matched in others.
struct CellProgress<'a> {
    of_scene: &'a dyn Progress,
    /// Number of cells before this one.
    done: u64,
    cell: &'a GroundCell,
}

impl Progress for CellProgress<'_> {
    fn event(&self, event: Event) {
        match event {
            Event::Started { stage, .. } => {
                let status = format!("{}: {stage}", self.cell.id);
                self.of_scene.event(Event::Advanced { done: self.done, status });
            }
            Event::Warning(text) => tracing::debug!("{}: {text}", self.cell.id),
            _ => {}
        }
    }

    fn is_cancelled(&self) -> bool {
        self.of_scene.is_cancelled()
    }
}

/// Views that no track of any cell shows.
fn views_without_tracks(scene: &Scene, results: &[CellResult]) -> Vec<LeftOut> {
    let mut is_tied = vec![false; scene.views.len()];
    let tracks = results.iter().flatten().flatten();
    tracks.flat_map(|t| &t.observations).for_each(|m| is_tied[m.view as usize] = true);
    let untied = scene.views.iter().zip(is_tied).filter(|(_, is_tied)| !is_tied);
    untied.map(|(view, _)| (view.name.clone(), "no cell of the ground has tie points in it".into())).collect()
}

impl<'a> Adjuster<'a> {
    /// Adjusts the tracks of all cells. A view that contradicts the others ends the attempt, unless the cameras are fixed:
    /// then it is kept with a warning.
    fn adjust_tracks(
        &mut self,
        scene: &Scene,
        results: &[CellResult],
        options: &'a BundleOptions,
    ) -> Result<Outcome, BundleError> {
        self.set_datum(scene, options)?;
        let mut estimate = Estimate::start(self.views.len());
        let mut tied = self.tracks_of_cells(scene, results);
        // Points at the border of two cells are in both.
        merge_duplicates(&mut tied);
        let groups =
            tracks::components(self.views.len(), tied.iter().map(|t| t.observations.iter().map(|m| m.view)));
        if groups.len() > 1 {
            if !options.fixed && has_majority(&groups) {
                return Ok(Outcome::Rejected(self.apart(&groups)));
            }
            return Err(self.not_connected(&groups));
        }
        let observed = tied.into_iter().chain(self.control.iter().cloned());
        self.network.triangulate_tracks(&mut estimate, observed.collect());
        let triangulated = self.observation_counts(&estimate.tracks);
        self.progress.event(Event::Started { stage: "adjusting", total: 0 });
        self.network.refine(&mut estimate, &LOSS_SCALES_PX, options.model, MIN_PATCH_LIMIT_PX)?;
        self.progress.event(Event::Finished);
        let kept = self.observation_counts(&estimate.tracks);
        if kept.iter().all(|n| *n == 0) {
            return Err(self.no_tracks());
        }
        let worst = self.worst_view(&triangulated, &kept);
        match worst.or_else(|| self.weakest_view(&estimate.tracks)) {
            Some(view) if !options.fixed => return Ok(Outcome::Rejected(vec![view])),
            Some((view, reason)) => self.progress.event(Event::Warning(format!("view `{view}`: {reason}"))),
            None => {}
        }
        self.narrow_heights(&estimate);
        Ok(Outcome::Adjusted(estimate))
    }

    /// The tracks of all cells in the used views; those that fewer than two of them show are dropped.
    fn tracks_of_cells(&self, scene: &Scene, results: &[CellResult]) -> Vec<Track> {
        let used: Vec<Option<usize>> = scene
            .views
            .iter()
            .map(|view| self.views.iter().position(|used| used.view.name == view.name))
            .collect();
        let track = |cell: usize, track: &CellTrack| {
            let seen = track.observations.iter().filter_map(|m| {
                let view = used[m.view as usize]?;
                let px = self.views[view].view.px_of_window(Pixel::new(m.px[0], m.px[1]));
                Some(Observation { view, px, weight: m.weight })
            });
            let observations: Vec<Observation> = seen.collect();
            let is_tied = observations.len() >= 2;
            is_tied.then_some(Track { observations, gray: track.gray, prior: None, cell: cell as u32 })
        };
        let of_cells =
            results.iter().enumerate().filter_map(|(cell, result)| Some((cell, result.as_ref().ok()?)));
        of_cells.flat_map(|(cell, tracks)| tracks.iter().filter_map(move |t| track(cell, t))).collect()
    }
}

/// Statistics of every cell; with fixed cameras those of the cameras as delivered.
fn reports(
    grid: &CellGrid,
    results: &[CellResult],
    adjuster: &Adjuster,
    estimate: &Estimate,
    fixed: bool,
) -> Vec<CellReport> {
    let given = fixed.then(|| adjuster.network.as_delivered(&estimate.tracks));
    let of = given.as_ref().unwrap_or(estimate);
    let block = adjuster.network.block();
    let mut tracks = vec![0; results.len()];
    let mut residuals_px = vec![Vec::new(); results.len()];
    for (track, point) in of.tracks.iter().zip(&of.points).filter(|(t, _)| t.prior.is_none()) {
        tracks[track.cell as usize] += 1;
        let residual = |m: &Observation| block.distance(m, &of.corrections[m.view], *point);
        residuals_px[track.cell as usize].extend(track.observations.iter().map(residual));
    }
    let report = |(i, cell): (usize, &GroundCell)| {
        let skipped = results[i].as_ref().err().cloned();
        CellReport::new(&cell.id, grid.center_deg(cell), tracks[i], &residuals_px[i], skipped)
    };
    grid.cells.iter().enumerate().map(report).collect()
}
