//! What is done of a plan: `satgs tile status`.

use super::done::{Done, Failure, tile_folder};
use super::error::TilesError;
use super::plan::{Plan, Tile};
use crate::pipeline::RunLock;
use serde::Serialize;
use std::path::Path;

/// How far a tile is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TileState {
    /// It is not begun, or was interrupted.
    Planned,
    /// A job works on it.
    Running,
    /// It is complete.
    Done,
    /// Its last job failed.
    Failed,
}

/// A tile of a [`Status`].
#[derive(Clone, Debug, Serialize)]
pub struct TileStatus {
    /// ID of the tile.
    pub id: String,
    /// How far it is.
    pub state: TileState,
    /// Why it failed.
    pub reason: Option<String>,
    /// Predicted duration on two cores, seconds.
    pub predicted_seconds: f64,
    /// Duration of its job, seconds.
    pub seconds: Option<f64>,
    /// Predicted peak memory, megabytes.
    pub predicted_memory_mb: f64,
    /// Peak memory of its job, megabytes.
    pub peak_memory_mb: Option<f64>,
}

/// What is done of a plan.
#[derive(Clone, Debug, Serialize)]
pub struct Status {
    /// Numbers of tiles that are not begun, at work, complete and failed.
    pub planned: usize,
    /// See `planned`.
    pub running: usize,
    /// See `planned`.
    pub done: usize,
    /// See `planned`.
    pub failed: usize,
    /// Predicted time for the tiles that are not complete, one after the other on machines like those of the complete
    /// tiles, seconds.
    pub seconds_left: f64,
    /// The tiles, in the order of the plan.
    pub tiles: Vec<TileStatus>,
}

/// The state of all tiles of a run.
///
/// # Errors
/// [`TilesError::RunFile`] if there is no plan.
pub fn status(run: &Path) -> Result<Status, TilesError> {
    let plan = Plan::read(run)?;
    let tiles: Vec<TileStatus> = plan.tiles.iter().map(|tile| of_tile(run, tile)).collect();
    let count = |state: TileState| tiles.iter().filter(|t| t.state == state).count();
    let sums = tiles.iter().filter_map(|t| Some((t.predicted_seconds, t.seconds?)));
    let (predicted, measured) = sums.fold((0.0, 0.0), |(p, m), (a, b)| (p + a, m + b));
    let factor = if predicted > 0.0 { measured / predicted } else { 1.0 };
    let left = tiles.iter().filter(|t| t.state != TileState::Done).map(|t| t.predicted_seconds);
    Ok(Status {
        planned: count(TileState::Planned),
        running: count(TileState::Running),
        done: count(TileState::Done),
        failed: count(TileState::Failed),
        seconds_left: factor * left.sum::<f64>(),
        tiles,
    })
}

fn of_tile(run: &Path, tile: &Tile) -> TileStatus {
    let folder = tile_folder(run, &tile.id);
    let done = Done::of_tile(run, tile);
    let failure = Failure::read(&folder);
    let state = match (&done, &failure) {
        (Some(_), _) => TileState::Done,
        _ if RunLock::is_held(&folder) => TileState::Running,
        (None, Some(_)) => TileState::Failed,
        (None, None) => TileState::Planned,
    };
    TileStatus {
        id: tile.id.clone(),
        state,
        reason: failure.filter(|_| state == TileState::Failed).map(|f| f.reason),
        predicted_seconds: tile.cost.seconds_2core,
        seconds: done.as_ref().map(|d| d.seconds),
        predicted_memory_mb: tile.cost.memory_mb,
        peak_memory_mb: done.as_ref().and_then(|d| d.peak_memory_mb),
    }
}
