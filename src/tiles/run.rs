//! All stages of a scene of any size in a row: `satgs run`.

use super::error::TilesError;
use super::job::run_tile;
use super::mosaic::{mosaic_locked, report};
use super::mosaicked::Mosaicked;
use super::plan::{Plan, TileSurface};
use super::plan_options::PlanOptions;
use super::planner::{needs_tiles, plan_locked};
use crate::metrics::Evaluation;
use crate::pipeline::{
    self, DsmOptions, ErrorKind, EvaluateOptions, Outcome, PipelineError, RunLock, RunOptions, StageResult,
    adjust_locked, evaluate,
};
use crate::progress::{Event, Progress};
use crate::run_files::{DSM, EVALUATION, PLAN};
use crate::scene::Scene;
use std::path::Path;

/// Options of a scene of any size.
#[derive(Clone, Debug)]
pub struct SceneOptions {
    /// Options of all stages.
    pub stages: RunOptions,
    /// Largest side of an area that is trained as a whole, and of the core of a tile, metres.
    pub core_m: f64,
    /// Width of the overlap around a core, metres.
    pub overlap_m: f64,
    /// Memory that a tile may take, megabytes.
    pub max_memory_mb: Option<f64>,
}

impl Default for SceneOptions {
    fn default() -> Self {
        let PlanOptions { core_m, overlap_m, max_memory_mb, .. } = PlanOptions::default();
        Self { stages: RunOptions::default(), core_m, overlap_m, max_memory_mb }
    }
}

/// The result of one stage of a scene of any size.
#[derive(Debug)]
pub enum SceneResult {
    /// A stage as of a scene of one tile.
    Stage(StageResult),
    /// The tiles are planned.
    Planned(Outcome<Plan>),
    /// The tiles are blended into one surface.
    Mosaicked(Outcome<Mosaicked>),
}

impl SceneOptions {
    /// Opens the files that late stages read, so that errors are found before a long training.
    ///
    /// # Errors
    /// [`TilesError`] of the option that is wrong.
    pub fn check(&self, run: &Path) -> Result<(), TilesError> {
        self.stages.check(run)?;
        Ok(self.plan_options().check()?)
    }

    fn plan_options(&self) -> PlanOptions {
        // All fields are named, so that none is forgotten: the others are refused by `require_options_of_tiles`.
        let DsmOptions {
            resolution_m,
            area: _,
            like: _,
            vertical,
            fill_m,
            no_fill,
            hillshade: _,
            dtm: _,
            points: _,
            mesh: _,
            overwrite,
        } = self.stages.dsm.clone();
        PlanOptions {
            core_m: self.core_m,
            overlap_m: self.overlap_m,
            max_memory_mb: self.max_memory_mb,
            resolution_m,
            surface: TileSurface { vertical, fill_m, no_fill, ..TileSurface::default() },
            train: self.stages.train.clone(),
            overwrite,
        }
    }

    /// An error if an option is given that only areas of one tile have.
    fn require_options_of_tiles(&self) -> Result<(), TilesError> {
        let dsm = &self.stages.dsm;
        let products = "the tools of GDAL make it from RUN/dsm.tif";
        let grid = "--resolution and --aoi set the grid, `gdalwarp` makes another of RUN/dsm.tif";
        let asked = [
            (dsm.like.is_some() || dsm.area.is_some(), "--like", grid),
            (dsm.hillshade, "--hillshade", products),
            (dsm.dtm, "--dtm", "`satgs dsm RUN/tiles/ID --dtm` makes it of a tile"),
            (dsm.points.is_some(), "--points", products),
            (dsm.mesh.is_some(), "--mesh", products),
        ];
        match asked.into_iter().find(|(is_asked, ..)| *is_asked) {
            Some((_, option, instead)) => Err(TilesError::OneTileOnly { option, instead }),
            None => Ok(()),
        }
    }
}

/// Does everything: adjusts, trains, renders, scores if there is a truth, and writes a report; an area larger than
/// `core_m` is cut into tiles, which are made one after the other and blended. `completed` receives the result of every
/// stage as soon as it is there. What is complete already is kept.
///
/// # Errors
/// [`TilesError`] of the first stage that fails. A tile that fails does not stop the others:
/// [`TilesError::Partial`] lists those that did, when everything else is complete.
pub fn run(
    scene: &Scene,
    options: &SceneOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(SceneResult),
) -> Result<(), TilesError> {
    options.check(run)?;
    let _lock = RunLock::make(run)?;
    let stages = &options.stages;
    let adjusted = adjust_locked(scene, &stages.adjust, run, progress)?;
    completed(SceneResult::Stage(StageResult::Adjusted(adjusted)));
    let planning = options.plan_options();
    if !run.join(PLAN).exists() && !needs_tiles(run, &planning)? {
        let mut of_stage = |result| completed(SceneResult::Stage(result));
        return Ok(pipeline::run_adjusted(run, stages, progress, &mut of_stage)?);
    }
    options.require_options_of_tiles()?;
    let planned = plan_locked(run, &planning, progress)?;
    let plan = Plan::read(run)?;
    completed(SceneResult::Planned(planned));
    let failed = make_tiles(run, &plan, stages.train.checkpoint_every, progress)?;
    completed(SceneResult::Mosaicked(mosaic_locked(run, progress)?));
    if let Some(truth) = &stages.truth {
        let scoring = EvaluateOptions { overwrite: true, ..stages.evaluate.clone() };
        let scores: Evaluation =
            evaluate(&run.join(DSM), truth, &scoring, Some(&run.join(EVALUATION)), progress)?;
        completed(SceneResult::Stage(StageResult::Evaluated(Box::new(scores))));
    }
    completed(SceneResult::Stage(StageResult::Reported(report(run)?)));
    if failed.is_empty() { Ok(()) } else { Err(TilesError::Partial { failed: failed.join(", ") }) }
}

/// Makes all tiles, one after the other, and returns the IDs of those that failed.
fn make_tiles(
    run: &Path,
    plan: &Plan,
    checkpoint_every: u32,
    progress: &dyn Progress,
) -> Result<Vec<String>, TilesError> {
    let (mut failed, mut first) = (Vec::new(), None);
    for (i, tile) in plan.tiles.iter().enumerate() {
        progress.check().map_err(PipelineError::from)?;
        progress.event(Event::Note(format!("tile {} of {}: {}", i + 1, plan.tiles.len(), tile.id)));
        match run_tile(run, &tile.id, checkpoint_every, progress) {
            Ok(_) => {}
            Err(e) if e.kind() == ErrorKind::Interrupted => return Err(e),
            Err(e) => {
                progress.event(Event::Warning(format!("tile `{}` failed: {}", tile.id, e.chain())));
                failed.push(tile.id.clone());
                first.get_or_insert(e);
            }
        }
    }
    match first {
        Some(first) if failed.len() == plan.tiles.len() => {
            Err(TilesError::AllFailed { first: Box::new(first) })
        }
        _ => Ok(failed),
    }
}
