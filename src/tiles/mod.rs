//! Areas larger than one training: a plan of tiles, one job a tile, and one mosaic.
//!
//! A scene is adjusted as a whole; then each tile is an ordinary run on a box of ground, with nothing exchanged between
//! tiles; then the tiles are blended along their seams. The files in the run folder are the interface between the jobs, so
//! that any engine can start them on any machine that sees the folder:
//!
//! | file | what |
//! |---|---|
//! | `tiles.json` | the [`Plan`] |
//! | `tiles/ID` | the run folder of a tile; `done.json` is written last |
//! | `mosaic/ID_*.tif` | the core of a tile, blended with its neighbours |
//! | `colour.json` | corrections of the tiles' colours, see [`TileColors`] |
//! | `dsm.tif`, `ortho.tif`, `confidence.tif`, `seams.gpkg` | the mosaic, and the differences at its seams |
//!
//! A job writes the same bytes whenever it has the same input, so one that is killed, repeated or done twice does no harm.

mod blend;
#[cfg(test)]
mod blend_tests;
mod cells;
mod colour;
mod cut;
mod done;
mod error;
mod export_tileset;
mod job;
#[cfg(test)]
mod made_tests;
mod margins;
mod mosaic;
mod mosaic_files;
#[cfg(test)]
mod mosaic_tests;
mod mosaicked;
mod page;
mod plan;
mod plan_options;
mod planner;
mod resources;
mod seam_summary;
mod seams;
mod status;
mod tile_rasters;

pub use blend::{Blended, blend};
pub use cells::MapBox;
pub use colour::{ColorCorrection, ColorStep, TileColors};
pub use done::{Done, Failure, FileSeal, Seals, seal, tile_folder};
pub use error::TilesError;
pub use export_tileset::export_scene_tileset;
pub use job::run_tile;
pub(crate) use mosaic::mosaic_locked;
pub use mosaic::{mosaic, report};
pub use mosaicked::{FailedTile, Mosaicked};
pub use plan::{Plan, PlannedFile, Tile, TileCost, TileSurface, TileTraining, TileView};
pub use plan_options::PlanOptions;
pub(crate) use planner::plan_locked;
pub use planner::{needs_tiles, plan};
pub use seam_summary::SeamSummary;
pub use seams::{ColorPairs, Seam};
pub use status::{Status, TileState, TileStatus, status};
