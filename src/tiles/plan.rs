//! The plan of a scene's tiles: `tiles.json`.

use super::TilesError;
use crate::io::{MapGrid, Window, read_json};
use crate::run_files::PLAN;
use crate::splat::train::recipe::Recipe;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the layout of `tiles.json`.
pub(super) const SCHEMA: u32 = 1;

/// A box on the map: west, south, east, north, metres of the plan's UTM zone. Its edges are multiples of the cell.
pub type MapBox = [f64; 4];

/// The tiles of a scene, and how they are trained and rendered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Version of this layout.
    pub schema: u32,
    /// Version of satgs that made the plan.
    pub satgs: String,
    /// Hash of the content of the plan, of the adjustment and of the scene.
    pub plan_hash: String,
    /// EPSG code of the UTM zone of all boxes.
    pub epsg: u32,
    /// Ellipsoidal height of the origin of all tiles, metres.
    pub origin_height_m: f64,
    /// Side of a cell of the rasters, metres.
    pub resolution_m: f64,
    /// How the tiles are trained.
    pub train: TileTraining,
    /// How their surfaces are rendered.
    pub surface: TileSurface,
    /// Hash of the record of the adjustment that the plan was made from.
    pub adjustment_hash: String,
    /// Largest side of a core, metres.
    pub core_m: f64,
    /// Width of the overlap around each core, metres.
    pub overlap_m: f64,
    /// The tiles, by rows from the south and by columns from the west.
    pub tiles: Vec<Tile>,
    /// Sum of the tiles' costs; its memory is the largest of any tile.
    pub total: TileCost,
}

/// How tiles are trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileTraining {
    /// Name of the recipe, or its TOML file, whose path counts from the run folder.
    pub recipe: String,
    /// Number of iterations; without one the recipe's own.
    pub iterations: Option<u32>,
    /// Seed of all random numbers.
    pub seed: u64,
}

/// How the surfaces of tiles are rendered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileSurface {
    /// Vertical reference of the heights; without one the ellipsoid.
    pub vertical: Option<String>,
    /// Fill holes up to this distance between cells with heights, metres.
    pub fill_m: Option<f64>,
}

/// A tile: what one job makes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tile {
    /// `x000_y000`: column from the west, row from the south.
    pub id: String,
    /// The part of the mosaic that comes from this tile. Cores cover the area without gaps or overlaps.
    pub core: MapBox,
    /// Where splats may live: the overlap box, and around it what occludes it or casts shadows on it.
    pub splat_box: MapBox,
    /// Lowest and highest ellipsoidal height, metres.
    pub heights_m: [f64; 2],
    /// The views that are trained on or tested, with the parts of their images that show the splat box.
    pub views: Vec<TileView>,
    /// Name of the view whose colours the orthophoto takes: the same for all tiles that it covers.
    pub reference: String,
    /// IDs of the tiles that share a side or a corner.
    pub neighbours: Vec<String>,
    /// Predicted cost.
    pub cost: TileCost,
    /// Hash of all that the tile's files depend on.
    pub input_hash: String,
}

/// A view of a tile.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TileView {
    /// Name of the view.
    pub name: String,
    /// Window of the whole image: first column and row, columns and rows, pixels.
    pub window: [usize; 4],
    /// Stored values that become 0 and 1, the same for all tiles; none for 8-bit images.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stretch: Option<[f32; 2]>,
}

/// Predicted cost of a tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileCost {
    /// Seconds on two cores.
    pub seconds_2core: f64,
    /// Peak memory, megabytes.
    pub memory_mb: f64,
    /// Bytes read from the images, megabytes.
    pub read_mb: f64,
}

impl Plan {
    /// Reads the plan of a run folder.
    ///
    /// # Errors
    /// [`TilesError::RunFile`].
    pub fn read(run: &Path) -> Result<Self, TilesError> {
        let made_by = "`satgs plan SCENE -o RUN` makes it";
        read_json(&run.join(PLAN)).map_err(|source| TilesError::RunFile { source, made_by })
    }

    /// The tile with this ID.
    #[must_use]
    pub fn tile(&self, id: &str) -> Option<&Tile> {
        self.tiles.iter().find(|tile| tile.id == id)
    }

    /// The IDs of all tiles, as text.
    #[must_use]
    pub fn ids(&self) -> String {
        self.tiles.iter().map(|tile| tile.id.as_str()).collect::<Vec<_>>().join(", ")
    }

    /// The recipe as an option of training: a name, or the path of a file in the run folder.
    #[must_use]
    pub fn recipe_in(&self, run: &Path) -> String {
        let recipe = &self.train.recipe;
        let is_named = Recipe::NAMES.contains(&recipe.as_str());
        if is_named { recipe.clone() } else { run.join(recipe).to_string_lossy().into_owned() }
    }

    /// The grid of a tile's core.
    #[must_use]
    pub fn core_grid(&self, tile: &Tile) -> MapGrid {
        let [w, s, e, n] = tile.core;
        MapGrid::covering(self.epsg, (w, s, e, n), self.resolution_m)
    }

    /// The grid of a tile's rasters: its core and the overlap around it.
    #[must_use]
    pub fn overlap_grid(&self, tile: &Tile) -> MapGrid {
        let ([w, s, e, n], o) = (tile.core, self.overlap_m);
        MapGrid::covering(self.epsg, (w - o, s - o, e + o, n + o), self.resolution_m)
    }

    /// The grid of the mosaic: all cores.
    #[must_use]
    pub fn mosaic_grid(&self) -> MapGrid {
        let all = self.tiles.iter().map(|tile| tile.core);
        let [w, s, e, n] = all.fold([f64::MAX, f64::MAX, f64::MIN, f64::MIN], |a, b| {
            [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
        });
        MapGrid::covering(self.epsg, (w, s, e, n), self.resolution_m)
    }
}

impl From<&TileView> for Window {
    fn from(view: &TileView) -> Self {
        let [col, row, width, height] = view.window;
        Self { col, row, width, height }
    }
}
