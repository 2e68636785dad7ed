//! Moving all files of a run to another place, as one step: either all are moved or none.
//!
//! The moved files are written into a folder beside the present ones, which is then renamed to `RUN/align.pending`. From
//! then on the run counts as moved: whichever call comes next puts the files in their place first.

use super::outdated::MOVED;
use super::products::Products;
use super::run_folder::colors::hash_of_splats;
use super::run_folder::stage::Stage;
use super::{PipelineError, RunLock, TrainedCameras, outdated};
use crate::bundle::Adjustment;
use crate::coregister::{Coregistration, Shift};
use crate::frame::Point;
use crate::io::{WriteError, read_georeference, read_json, write_json, write_moved};
use crate::progress::{NoProgress, Progress};
use crate::run_files::{
    ABOVE_GROUND, ADJUSTMENT, APPEARANCE, CAMERAS, CONFIDENCE, DSM, FIRST_SURFACE, GROUND, HEIGHT_SPLATS,
    HILLSHADE, ORTHO, PREDICTED, SPLATS, SURFACE,
};
use crate::scene::Scene;
use crate::splat::appearance::satgs::TrainedAppearance;
use crate::splat::ply;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The record of an alignment, in the run folder, and the folder of moved files that are not in their place yet.
pub(super) const RECORD: &str = "align.json";
const PENDING: &str = "align.pending";
/// Rasters that move: those whose first band holds heights, and the others.
const HEIGHTS: [&str; 4] = [DSM, GROUND, SURFACE, FIRST_SURFACE];
const MAPS: [&str; 4] = [ORTHO, CONFIDENCE, HILLSHADE, ABOVE_GROUND];

/// The content of `RUN/align.json`.
#[derive(Serialize, Deserialize)]
pub(super) struct Record {
    /// What the run was last aligned to.
    pub reference: PathBuf,
    /// The last shift, and what it left.
    #[serde(flatten)]
    pub last: Coregistration,
    /// Sum of all shifts since the adjustment.
    pub total: Shift,
}

impl Record {
    /// The record of a run, if it was aligned.
    pub fn read(run: &Path) -> Result<Option<Self>, PipelineError> {
        let path = run.join(RECORD);
        let read = path.exists().then(|| read_json(&path)).transpose();
        let made_by = "`satgs align RUN --to REFERENCE` makes it again once it is removed";
        read.map_err(|source| PipelineError::RunFile { source, made_by })
    }
}

/// Moves everything the run holds; the caller holds the lock.
pub(super) fn relocate(
    run: &Path,
    scene: &Scene,
    adjustment: Adjustment,
    step: [f64; 3],
    record: &Record,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    let failed = |e: std::io::Error| WriteError::new(run, e);
    let pending = tempfile::Builder::new().prefix(".satgs-align-").tempdir_in(run).map_err(failed)?;
    write_moved_files(run, pending.path(), scene, adjustment, step, record)?;
    // The one step that decides: before it nothing has moved, after it everything will.
    let pending = pending.keep();
    std::fs::rename(&pending, run.join(PENDING)).map_err(failed)?;
    put_in_place(run, progress)
}

/// Writes everything the run holds, moved, into a folder of the same layout. `step` is the shift in degrees of longitude
/// and latitude and metres of height.
fn write_moved_files(
    run: &Path,
    to: &Path,
    scene: &Scene,
    adjustment: Adjustment,
    step: [f64; 3],
    record: &Record,
) -> Result<(), PipelineError> {
    let shift = record.last.shift;
    let mut adjustment = adjustment.moved_on_ground(step);
    adjustment.report.gauge = format!("aligned to {}", record.reference.display());
    for c in &mut adjustment.report.control {
        c.moved_m = std::array::from_fn(|k| c.moved_m[k] + shift.enu()[k]);
    }
    adjustment.write(&to.join(ADJUSTMENT), scene)?;
    if run.join(CAMERAS).exists() {
        let mut cameras = TrainedCameras::read(run)?;
        let origin = cameras.setup.site.origin;
        let [x, y, z] = origin.xyz();
        cameras.setup.site.origin = Point::new(x + shift.east_m, y + shift.north_m, z + shift.up_m);
        write_json(&to.join(CAMERAS), &cameras)?;
        for name in [SPLATS, HEIGHT_SPLATS].into_iter().filter(|name| run.join(name).exists()) {
            ply::write(&to.join(name), &ply::read(&run.join(name))?, &cameras.setup.site)?;
        }
        // The colour model names the splats that it belongs to by the hash of their file, which holds their place.
        if run.join(APPEARANCE).exists() {
            let mut appearance = TrainedAppearance::read(&run.join(APPEARANCE))?;
            appearance.content.splats = hash_of_splats(&to.join(SPLATS))?;
            appearance.write(&to.join(APPEARANCE))?;
        }
    }
    // The splats from which training continues have a georeference of their own.
    let predicted = run.join(PREDICTED);
    let made_by = "`satgs predict RUN -o RUN2 --overwrite` makes it";
    let site = read_georeference(&predicted).map_err(|source| PipelineError::RunFile { source, made_by })?;
    if let Some(mut site) = site {
        let [x, y, z] = site.origin.xyz();
        site.origin = Point::new(x + shift.east_m, y + shift.north_m, z + shift.up_m);
        ply::write(&to.join(PREDICTED), &ply::read(&predicted)?, &site)?;
    }
    let heights = HEIGHTS.iter().map(|name| (name, shift.enu()));
    let maps = MAPS.iter().map(|name| (name, [shift.east_m, shift.north_m, 0.0]));
    let products = Products::all(run);
    let is_own = |name: &str| !MOVED.contains(&name) || products.iter().any(|path| path == Path::new(name));
    for (name, by) in heights.chain(maps).filter(|(name, _)| is_own(name) && run.join(name).exists()) {
        write_moved(&run.join(name), &to.join(name), by)?;
    }
    Ok(write_json(&to.join(RECORD), record)?)
}

/// Removes the record of an alignment, because the run is adjusted again.
pub(super) fn forget(run: &Path) -> Result<(), PipelineError> {
    let gone = [std::fs::remove_file(run.join(RECORD)), std::fs::remove_dir_all(run.join(PENDING))];
    let refused = gone.into_iter().filter_map(Result::err).find(|e| e.kind() != std::io::ErrorKind::NotFound);
    refused.map_or(Ok(()), |e| Err(WriteError::new(run, e).into()))
}

/// Completes a move that was interrupted, if there is one.
pub(super) fn finish(run: &Path) -> Result<(), PipelineError> {
    if !run.join(PENDING).exists() {
        return Ok(());
    }
    let _lock = RunLock::existing(run)?;
    finish_locked(run)
}

/// As [`finish`]; the caller holds the lock.
pub(super) fn finish_locked(run: &Path) -> Result<(), PipelineError> {
    put_in_place(run, &NoProgress)
}

/// Puts moved files in their place, if there are some, and removes what still shows the old one.
fn put_in_place(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    let pending = run.join(PENDING);
    if !pending.exists() {
        return Ok(());
    }
    // The next call of `dsm` renders the surface again, on whole cells.
    Stage::new(run, "dsm", Vec::new(), Default::default()).forget()?;
    let failed = |e: std::io::Error| WriteError::new(run, e);
    outdated::after_move(run, progress)?;
    put(&pending, run).map_err(failed)?;
    Ok(std::fs::remove_dir_all(&pending).map_err(failed)?)
}

/// Moves the files of a folder into another, over those that are there.
fn put(from: &Path, to: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(from)? {
        let (entry, target) = entry.map(|e| (e.path(), to.join(e.file_name())))?;
        if entry.is_dir() {
            std::fs::create_dir_all(&target)?;
            put(&entry, &target)?;
        } else {
            std::fs::rename(&entry, &target)?;
        }
    }
    Ok(())
}
