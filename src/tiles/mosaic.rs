//! The mosaic of all tiles: the products of a scene, its seams and its failed tiles.

use super::TilesError;
use super::blend::{Blended, VERSION, blend_tile};
use super::colour::TileColors;
use super::done::{Done, Failure, Seals, are_sound, seal, tile_folder};
use super::mosaic_files::MosaicFiles;
use super::mosaicked::{FailedTile, Mosaicked};
use super::page::write_page;
use super::plan::Plan;
use super::seam_summary::SeamSummary;
use super::seams::Seam;
use crate::dsm::CellCounts;
use crate::io::{read_json, remove_if_there, write_json};
use crate::pipeline::{Outcome, PipelineError, RunLock, after_surface};
use crate::progress::{Event, Progress};
use crate::run_files::{COLORS, CONFIDENCE, DSM, FAILED, MOSAIC};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What the mosaic was made from, in its folder.
const RECORD: &str = "mosaic.json";

#[derive(Serialize, Deserialize)]
struct Record {
    input_hash: String,
    files: Seals,
    summary: Mosaicked,
    seams: Vec<Seam>,
}

/// Assembles the tiles that are done into `dsm.tif`, `ortho.tif` and `confidence.tif`; also writes `seams.gpkg`, `colour.json`,
/// `report.html`, and `failed.gpkg` if a tile is not done. Cores whose tile or neighbours have changed are blended first;
/// tiles that are not done are taken as absent.
///
/// The mosaic is kept if it was made from the same cores.
///
/// # Errors
/// [`TilesError::NothingDone`] if no tile is done, or [`TilesError`] if a file is damaged or cannot be written.
pub fn mosaic(run: &Path, progress: &dyn Progress) -> Result<Outcome<Mosaicked>, TilesError> {
    let _lock = RunLock::existing(run).map_err(TilesError::of_lock)?;
    let outcome = mosaic_locked(run, progress)?;
    report(run)?;
    Ok(outcome)
}

/// As [`mosaic`], without the report; the caller holds the lock.
pub(crate) fn mosaic_locked(run: &Path, progress: &dyn Progress) -> Result<Outcome<Mosaicked>, TilesError> {
    let plan = Plan::read(run)?;
    let (done, absent): (Vec<_>, Vec<_>) =
        plan.tiles.iter().partition(|tile| Done::of_tile(run, tile).is_some());
    if done.is_empty() {
        return Err(TilesError::NothingDone { run: run.into() });
    }
    let reason = |id: &str| Failure::read(&tile_folder(run, id)).map(|failure| failure.reason);
    let failed: Vec<FailedTile> = absent
        .iter()
        .map(|t| FailedTile { id: t.id.clone(), reason: reason(&t.id).unwrap_or_else(|| "not done".into()) })
        .collect();
    let without: Vec<String> = failed.iter().map(|t| t.id.clone()).collect();
    progress.event(Event::Started { stage: "blending tiles", total: done.len() as u64 });
    let mut cores = Vec::new();
    for (i, tile) in done.iter().enumerate() {
        progress.check().map_err(PipelineError::from)?;
        cores.push(blend_tile(run, &plan, tile, &without)?.0);
        progress.event(Event::Advanced { done: i as u64 + 1, status: String::new() });
    }
    progress.event(Event::Finished);
    let input_hash = input_hash(&plan, &cores, &failed);
    let record = run.join(MOSAIC).join(RECORD);
    let kept = read_json::<Record>(&record).ok();
    if let Some(kept) = kept.filter(|r| r.input_hash == input_hash && are_sound(&r.files, run)) {
        progress.event(Event::Note(format!("`{}` has its mosaic already", run.display())));
        return Ok(Outcome::Kept(Some(kept.summary)));
    }
    // Files of two states must not pass for one.
    remove_if_there(&record)?;
    let seams: Vec<Seam> = cores.iter().flat_map(|core| core.seams.iter().cloned()).collect();
    let colors = TileColors::solve(&seams, input_hash.clone());
    write_json(&run.join(COLORS), &colors)?;
    let files = MosaicFiles { run, plan: &plan, cores: &cores, colors: &colors };
    let mut names = files.write_rasters(progress)?;
    let summary = Mosaicked {
        grid: plan.mosaic_grid(),
        cells: CellCounts::of_files(&run.join(DSM), &run.join(CONFIDENCE))?,
        tiles: cores.len(),
        failed,
        seams: SeamSummary::of(&seams, &colors),
    };
    names.extend(files.write_seams(&seams)?);
    if summary.failed.is_empty() {
        remove_if_there(&run.join(FAILED))?;
    } else {
        names.extend(files.write_failed(&summary.failed)?);
    }
    after_surface(run, progress)?;
    let files = seal(run, &names).map_err(TilesError::of_own_file)?;
    write_json(&record, &Record { input_hash, files, summary: summary.clone(), seams })?;
    Ok(Outcome::Made(summary))
}

/// Writes the page of a run, with its seams and tiles if it has several, and returns the path of the page.
///
/// # Errors
/// [`TilesError`] if the folder holds no run, a file is damaged, or the page cannot be written.
pub fn report(run: &Path) -> Result<PathBuf, TilesError> {
    if !run.join(MOSAIC).join(RECORD).exists() {
        return Ok(crate::pipeline::report(run)?);
    }
    let plan = Plan::read(run)?;
    let made_by = "`satgs mosaic RUN` makes it";
    let damaged = |source| TilesError::RunFile { source, made_by };
    let record: Record = read_json(&run.join(MOSAIC).join(RECORD)).map_err(damaged)?;
    let colors: TileColors = read_json(&run.join(COLORS)).map_err(damaged)?;
    let page = write_page(run, &plan, &record.summary, &record.seams, &colors)?;
    // The Item lists the page.
    crate::pipeline::list_products(run)?;
    Ok(page)
}

/// Hash of all that the mosaic depends on.
fn input_hash(plan: &Plan, cores: &[Blended], failed: &[FailedTile]) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(format!("{VERSION} {} {:?} {failed:?}\n", plan.epsg, plan.mosaic_grid()).as_bytes());
    for core in cores {
        hasher.update(format!("{} {} {:?}\n", core.id, core.input_hash, core.files).as_bytes());
    }
    hasher.finalize().to_hex()[..32].to_owned()
}
