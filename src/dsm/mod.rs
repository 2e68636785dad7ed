//! Georeferenced products of splats on a map grid: a surface model, an orthophoto and confidence; a point cloud and a mesh.
//!
//! Splats are rendered with a camera that looks straight down and whose pixels are the cells of the grid, without an
//! intermediate point cloud or resampling. Heights are those of a matched surface, or medians or means of the splats
//! ([`HeightsFrom`]).

mod altitude;
mod confidence;
mod counts;
mod expected_error;
mod ground;
mod heights;
mod hillshade;
mod mesh;
mod nadir;
mod points;
mod render;
mod spikes;
mod writers;

pub use altitude::{altitudes, view_altitudes};
pub use confidence::{Confidence, Seeing};
pub use counts::{CellCounts, EXPECTED_ERROR_BAND, VIEWS_BAND, is_confirmed};
pub use ground::bare_ground;
pub use heights::{HeightScale, Heights, height_style};
pub use hillshade::hillshade;
pub use nadir::nadir_camera;
pub use render::{HeightsFrom, render};

use crate::io::{Grid2, MapGrid};

/// A digital surface model with an orthophoto and its confidence, on a map grid.
pub struct Dsm {
    /// The map grid, of which every raster has the size.
    pub grid: MapGrid,
    /// Ellipsoidal heights in metres; NaN where there is none.
    pub height: Grid2,
    /// Red, green and blue of the sunlit surface in the radiometry of the reference view, 0 to 1; NaN where there is no
    /// height.
    pub colors: [Grid2; 3],
    /// Confidence of the heights.
    pub confidence: Confidence,
    /// Metadata items that are written to all raster files.
    pub metadata: Vec<(&'static str, String)>,
}
