//! Georeferenced products of splats: a surface model, an orthophoto and its confidence on a map grid, points and a mesh.
//!
//! The camera looks straight down and its pixels are the grid's cells: no point cloud, no resampling. Heights are those
//! of a matched surface, or the splats' medians or means ([`HeightsFrom`]).

mod altitude;
mod confidence;
mod heights;
mod hillshade;
mod mesh;
mod nadir;
mod points;
mod render;
mod writers;

pub use altitude::altitudes;
pub use confidence::{Confidence, Seeing};
pub use heights::Heights;
pub use hillshade::hillshade;
pub use nadir::nadir_camera;
pub use render::{HeightsFrom, render};

use crate::io::{Grid2, MapGrid};

/// A digital surface model with an orthophoto and its confidence, on a map grid.
pub struct Dsm {
    /// The map grid.
    pub grid: MapGrid,
    /// Ellipsoidal heights in metres; NaN where nothing was seen.
    pub height: Grid2,
    /// Colours in the reference view's radiometry, sunlit, 0 to 1, as the splats have them; NaN where nothing was seen.
    pub colors: [Grid2; 3],
    /// Confidence of the heights.
    pub confidence: Confidence,
    /// Metadata items of all raster files.
    pub metadata: Vec<(&'static str, String)>,
}
