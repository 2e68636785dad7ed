//! What a mosaic consists of.

use super::seam_summary::SeamSummary;
use crate::dsm::CellCounts;
use crate::io::MapGrid;
use serde::{Deserialize, Serialize};

/// A tile that the mosaic lacks.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FailedTile {
    /// ID of the tile.
    pub id: String,
    /// Why it failed.
    pub reason: String,
}

/// A mosaic.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Mosaicked {
    /// Grid of the rasters.
    pub grid: MapGrid,
    /// Cells with a height, and what their heights rest on.
    pub cells: CellCounts,
    /// Number of tiles in the mosaic.
    pub tiles: usize,
    /// Tiles that are not done: their cores have no data.
    pub failed: Vec<FailedTile>,
    /// Differences at the seams.
    pub seams: SeamSummary,
}
