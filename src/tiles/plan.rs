//! The plan of a scene's tiles: `tiles.json`.

use super::TilesError;
use super::cells::{Cells, MapBox};
use crate::estimate::Cost;
use crate::io::{MapGrid, Window, read_json};
use crate::pipeline::{PipelineError, hash, hash_file, made_from};
use crate::run_files::{ADJUSTMENT, PLAN, SPARSE_POINTS, STAGE};
use crate::splat::recipe::Recipe;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Cores for which times are predicted.
const CORES: f64 = 2.0;
/// Bytes in a megabyte.
const MEGABYTE: f64 = 1e6;
/// Version of the layout of `tiles.json`.
pub(super) const SCHEMA: u32 = 2;

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
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileTraining {
    /// Name of the recipe, or its TOML file, whose path counts from the run folder.
    pub recipe: String,
    /// Hash of the content of the recipe.
    pub recipe_hash: String,
    /// Number of iterations; without one the recipe's own.
    pub iterations: Option<u32>,
    /// Stop at the matched surface.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub no_splats: bool,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Start from splats that are predicted of the matched surface.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub predict: bool,
    /// Number of pictures of the progress of each tile.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub snapshots: u32,
    /// Network of the features that show what images do not share.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub features: Option<PlannedFile>,
    /// Network of the perceptual loss.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips: Option<PlannedFile>,
}

/// A file that the jobs read, which run in other folders.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PlannedFile {
    /// Its absolute path.
    pub path: PathBuf,
    /// Hash of its content.
    pub hash: String,
}

fn is_zero(number: &u32) -> bool {
    *number == 0
}

impl PlannedFile {
    /// A file that is there now.
    pub(super) fn of(path: &Path) -> Self {
        Self { path: path.canonicalize().unwrap_or_else(|_| path.into()), hash: hash_file(path) }
    }

    /// The path, unless the file is another one than was planned with.
    pub(super) fn require_same(&self) -> Result<PathBuf, TilesError> {
        if hash_file(&self.path) == self.hash {
            return Ok(self.path.clone());
        }
        Err(TilesError::OtherFile { path: self.path.clone() })
    }
}

/// How the surfaces of tiles are rendered.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TileSurface {
    /// Vertical reference of the heights, the absolute path of a grid for instance; without one the ellipsoid.
    pub vertical: Option<String>,
    /// Hash of the content of the grid, if the vertical reference is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vertical_hash: Option<String>,
    /// Fill holes up to this distance between cells with heights, metres.
    pub fill_m: Option<f64>,
    /// Leave cells that fewer than two views confirm as nodata.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub no_fill: bool,
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
    /// Lowest and highest ellipsoidal height of the tie points, with margins, metres: what the boxes, the windows of the views and
    /// the cost are made for.
    pub heights_m: [f64; 2],
    /// Lowest and highest ellipsoidal height between which the surface is searched, metres.
    pub searched_m: [f64; 2],
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

impl TileCost {
    /// The cost of a tile for which so many bytes of the images are read.
    #[must_use]
    pub fn new(cost: Cost, read_bytes: u64) -> Self {
        let Cost { core_seconds, memory_mb } = cost;
        Self {
            seconds_2core: (core_seconds / CORES).ceil(),
            memory_mb,
            read_mb: read_bytes as f64 / MEGABYTE,
        }
    }
}

impl Plan {
    /// Reads the plan of a run folder.
    ///
    /// # Errors
    /// [`TilesError::RunFile`].
    pub fn read(run: &Path) -> Result<Self, TilesError> {
        let made_by = "`satgs plan SCENE -o RUN` makes it";
        let read = read_json(&run.join(PLAN));
        let mut plan: Self = read.map_err(|source| TilesError::RunFile { source, made_by })?;
        plan.check().map_err(|reason| TilesError::Damaged { run: run.into(), reason })?;
        // The plan may have been edited: another list of views is another tile.
        plan.set_input_hashes()?;
        Ok(plan)
    }

    /// What is wrong with a plan that was read from a file.
    fn check(&self) -> Result<(), String> {
        if self.schema != SCHEMA {
            return Err(format!("`schema` is {}, this version of satgs reads {SCHEMA}", self.schema));
        }
        let is_length = |v: f64| v.is_finite() && v > 0.0;
        if !is_length(self.resolution_m) || !is_length(self.overlap_m) || !self.origin_height_m.is_finite() {
            return Err("`resolution_m`, `overlap_m` or `origin_height_m` is not a length".into());
        }
        let mut ids = std::collections::BTreeSet::new();
        for tile in &self.tiles {
            let id = &tile.id;
            let digits = |text: &str| text.len() >= 3 && text.bytes().all(|b| b.is_ascii_digit());
            let parts = id.strip_prefix('x').and_then(|rest| rest.split_once("_y"));
            if !parts.is_some_and(|(x, y)| digits(x) && digits(y)) || !ids.insert(id) {
                return Err(format!("`{id}` is not the `id` of a tile, or another tile has it too"));
            }
            let is_box =
                |b: &MapBox| b.iter().all(|v| v.is_finite() && v.abs() < 1e8) && b[0] < b[2] && b[1] < b[3];
            let [low, high] = tile.heights_m;
            if !is_box(&tile.core) || !is_box(&tile.splat_box) || !is_length(high - low) {
                return Err(format!("tile `{id}`: `core`, `splat_box` or `heights_m` is empty"));
            }
            if !is_length(tile.searched_m[1] - tile.searched_m[0]) {
                return Err(format!("tile `{id}`: `searched_m` is empty"));
            }
        }
        Ok(())
    }

    /// Computes what the files of every tile depend on.
    pub(super) fn set_input_hashes(&mut self) -> Result<(), TilesError> {
        let frame =
            (self.schema, &self.satgs, self.epsg, self.origin_height_m, self.resolution_m, self.overlap_m);
        let common = to_json(&(frame, &self.train, &self.surface, &self.adjustment_hash))?;
        for tile in &mut self.tiles {
            // The cost is a prediction, on which no byte depends; neighbours matter to blending only.
            let bare = Tile {
                cost: TileCost::default(),
                neighbours: Vec::new(),
                input_hash: String::new(),
                ..tile.clone()
            };
            tile.input_hash = hash(format!("{common}{}", to_json(&bare)?).as_bytes());
        }
        Ok(())
    }

    /// An error if the run was adjusted again after it was planned.
    pub(super) fn require_current(&self, run: &Path) -> Result<(), TilesError> {
        if adjustment_hash(run)? == self.adjustment_hash {
            return Ok(());
        }
        Err(TilesError::OtherAdjustment { run: run.into() })
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
        let is_named = Recipe::named(recipe).is_some();
        if is_named { recipe.clone() } else { run.join(recipe).to_string_lossy().into_owned() }
    }

    /// Width of the overlap in cells.
    pub(super) fn overlap_cells(&self) -> i64 {
        (self.overlap_m / self.resolution_m).round() as i64
    }

    /// The grid of a tile's rasters: its core and the overlap around it.
    #[must_use]
    pub fn overlap_grid(&self, tile: &Tile) -> MapGrid {
        Cells::of_box(tile.core, self.resolution_m)
            .grown(self.overlap_cells())
            .grid(self.epsg, self.resolution_m)
    }

    /// The grid of the mosaic: all cores.
    #[must_use]
    pub fn mosaic_grid(&self) -> MapGrid {
        let all = self.tiles.iter().map(|tile| tile.core);
        let [w, s, e, n] = all.fold([f64::MAX, f64::MAX, f64::MIN, f64::MIN], |a, b| {
            [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
        });
        Cells::of_box([w, s, e, n], self.resolution_m).grid(self.epsg, self.resolution_m)
    }
}

impl From<&TileView> for Window {
    fn from(view: &TileView) -> Self {
        let [col, row, width, height] = view.window;
        Self { col, row, width, height }
    }
}

/// Hash of the result of an adjustment and of what it was made from, whatever the command line was.
pub(super) fn adjustment_hash(run: &Path) -> Result<String, TilesError> {
    let folder = run.join(ADJUSTMENT);
    let mut text = to_json(&made_from(&folder.join(STAGE))?)?;
    let mut cameras: Vec<PathBuf> = std::fs::read_dir(folder.join("rpcs"))
        .map(|files| files.filter_map(|file| Some(file.ok()?.path())).collect())
        .unwrap_or_default();
    cameras.retain(|path| path.extension().is_some_and(|e| e == "json"));
    cameras.sort();
    for path in cameras.into_iter().chain([folder.join(SPARSE_POINTS)]) {
        text += &hash_file(&path);
    }
    Ok(hash(text.as_bytes()))
}

pub(super) fn to_json(value: &impl Serialize) -> Result<String, TilesError> {
    let failed = |source| PipelineError::Json { what: "the plan", source };
    Ok(serde_json::to_string(value).map_err(failed)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(core: MapBox, resolution_m: f64, overlap_m: f64) -> Plan {
        let tile = Tile {
            id: "x000_y000".into(),
            core,
            splat_box: core,
            heights_m: [0.0, 1.0],
            searched_m: [0.0, 1.0],
            views: Vec::new(),
            reference: String::new(),
            neighbours: Vec::new(),
            cost: TileCost::default(),
            input_hash: String::new(),
        };
        Plan {
            schema: SCHEMA,
            satgs: String::new(),
            plan_hash: String::new(),
            epsg: 32631,
            origin_height_m: 0.0,
            resolution_m,
            train: TileTraining {
                recipe: "best".into(),
                recipe_hash: String::new(),
                ..TileTraining::default()
            },
            surface: TileSurface::default(),
            adjustment_hash: String::new(),
            core_m: 512.0,
            overlap_m,
            tiles: vec![tile],
            total: TileCost::default(),
        }
    }

    #[test]
    fn the_overlap_is_a_whole_number_of_cells_whatever_their_size() {
        for (cell, overlap) in [(0.6, 32.4), (0.35, 32.2), (1.1, 33.0), (0.5, 32.0)] {
            let core =
                [702_000.0, 4_797_000.0, 702_300.0, 4_797_300.0].map(|v: f64| (v / cell).round() * cell);
            let plan = plan(core, cell, overlap);
            let grid = plan.overlap_grid(&plan.tiles[0]);
            let cells = (overlap / cell).round();
            assert!((grid.west - (core[0] - cells * cell)).abs() < 1e-6, "{cell}");
            assert!((grid.north - (core[3] + cells * cell)).abs() < 1e-6, "{cell}");
            assert_eq!(grid.width as f64, ((core[2] - core[0]) / cell).round() + 2.0 * cells);
        }
    }

    #[test]
    fn plans_that_are_not_plans_are_refused() {
        let good = plan([0.0, 0.0, 10.0, 10.0], 0.5, 32.0);
        assert!(good.check().is_ok());
        for id in ["", ".", "..", "x0_y0", "x000_y000/..", "y000_x000"] {
            let mut wrong = good.clone();
            wrong.tiles[0].id = id.into();
            assert!(wrong.check().unwrap_err().contains("id"), "{id}");
        }
        let mut wrong = good.clone();
        wrong.tiles.push(good.tiles[0].clone());
        assert!(wrong.check().is_err(), "two tiles of one ID");
        assert!(Plan { schema: SCHEMA + 1, ..good.clone() }.check().unwrap_err().contains("schema"));
        assert!(Plan { resolution_m: f64::NAN, ..good.clone() }.check().is_err());
        let mut wrong = good.clone();
        wrong.tiles[0].core[2] = f64::INFINITY;
        assert!(wrong.check().unwrap_err().contains("core"));
    }

    #[test]
    fn an_edited_tile_has_another_hash_and_its_cost_does_not_matter() {
        let mut plan = plan([0.0, 0.0, 10.0, 10.0], 0.5, 32.0);
        plan.set_input_hashes().unwrap();
        let before = plan.tiles[0].input_hash.clone();
        plan.tiles[0].cost.memory_mb = 7.0;
        plan.set_input_hashes().unwrap();
        assert_eq!(plan.tiles[0].input_hash, before);
        plan.tiles[0].heights_m[1] = 2.0;
        plan.set_input_hashes().unwrap();
        assert_ne!(plan.tiles[0].input_hash, before);
    }
}
