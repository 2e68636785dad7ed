//! Runs of tiles that are made without training, for tests of blending and of the mosaic.

use super::cut::BANDS;
use super::{Done, Plan, Tile, TileCost, TileSurface, TileTraining, seal, tile_folder};
use crate::io::{Cog, Grid2, VerticalReference, write_json};
use crate::run_files::{CONFIDENCE, DSM, ORTHO, PLAN};
use std::path::Path;

pub(super) const CELL_M: f64 = 0.5;
pub(super) const OVERLAP: usize = 8;
const EPSG: u32 = 32617;
const WEST: f64 = 435_000.0;
const SOUTH: f64 = 3_354_000.0;

/// A run of tiles. `at(column of tiles, row of tiles, column, row)` gives a cell; columns and rows of cells count from the
/// north-west corner of all cores, rows of tiles from the south.
pub(super) struct Made<'a> {
    pub(super) columns: &'a [usize],
    pub(super) rows: &'a [usize],
    pub(super) at: &'a dyn Fn(usize, usize, i64, i64) -> [f32; BANDS],
}

impl Made<'_> {
    pub(super) fn id(col: usize, row: usize) -> String {
        format!("x{col:03}_y{row:03}")
    }

    /// First column, and first row from the north, of the core of a tile.
    pub(super) fn start(&self, col: usize, row: usize) -> (i64, i64) {
        let west: usize = self.columns[..col].iter().sum();
        let north: usize = self.rows[row + 1..].iter().sum();
        (west as i64, north as i64)
    }

    pub(super) fn plan(&self) -> Plan {
        let total: usize = self.rows.iter().sum();
        let all: Vec<_> =
            (0..self.rows.len()).flat_map(|r| (0..self.columns.len()).map(move |c| (c, r))).collect();
        let tiles = all.iter().map(|&(col, row)| {
            let (west, north) = self.start(col, row);
            let w = WEST + west as f64 * CELL_M;
            let n = SOUTH + (total as i64 - north) as f64 * CELL_M;
            let core = [w, n - self.rows[row] as f64 * CELL_M, w + self.columns[col] as f64 * CELL_M, n];
            let near = |&&(c, r): &&(usize, usize)| {
                (c, r) != (col, row) && c.abs_diff(col) <= 1 && r.abs_diff(row) <= 1
            };
            Tile {
                id: Self::id(col, row),
                core,
                splat_box: core,
                heights_m: [0.0, 50.0],
                searched_m: [0.0, 50.0],
                views: Vec::new(),
                reference: "v00".into(),
                neighbours: all.iter().filter(near).map(|&(c, r)| Self::id(c, r)).collect(),
                cost: TileCost::default(),
                input_hash: "0".into(),
            }
        });
        let mut plan = Plan {
            schema: super::plan::SCHEMA,
            satgs: "0.1.0".into(),
            plan_hash: "0".into(),
            epsg: EPSG,
            origin_height_m: 0.0,
            resolution_m: CELL_M,
            train: TileTraining { recipe: "best".into(), ..TileTraining::default() },
            surface: TileSurface::default(),
            adjustment_hash: "0".into(),
            total: TileCost::default(),
            core_m: self.columns[0] as f64 * CELL_M,
            overlap_m: OVERLAP as f64 * CELL_M,
            tiles: tiles.collect(),
        };
        plan.set_input_hashes().unwrap();
        plan
    }

    /// Writes the plan and all tiles.
    pub(super) fn write(&self, run: &Path) {
        write_json(&run.join(PLAN), &self.plan()).unwrap();
        for row in 0..self.rows.len() {
            for col in 0..self.columns.len() {
                self.write_tile(run, col, row);
            }
        }
    }

    pub(super) fn write_tile(&self, run: &Path, col: usize, row: usize) {
        let (plan, id) = (self.plan(), Self::id(col, row));
        let grid = plan.overlap_grid(plan.tile(&id).unwrap());
        let bands = self.bands(col, row);
        let folder = tile_folder(run, &id);
        let metadata = [("INPUTS", format!("v00, v{:02}", 1 + col))];
        let above = VerticalReference::read("ellipsoid").unwrap();
        let cog = Cog { grid, metadata: &metadata, heights_from: None };
        let heights = Cog { heights_from: Some(&above), ..cog };
        heights.write_f32(&folder.join(DSM), &[("height", "m", &bands[0])]).unwrap();
        let byte = |g: &Grid2| g.data.iter().map(|v| if v.is_nan() { 0 } else { *v as u8 }).collect();
        cog.write_u8(&folder.join(ORTHO), bands[1..4].iter().map(byte).collect(), Some(0.0)).unwrap();
        let names = [
            ("opacity", "", &bands[4]),
            ("altitude spread", "m", &bands[5]),
            ("views", "", &bands[6]),
            ("expected error", "m", &bands[7]),
        ];
        cog.write_f32(&folder.join(CONFIDENCE), &names).unwrap();
        let files = seal(&folder, &[DSM, ORTHO, CONFIDENCE].map(str::to_owned)).unwrap();
        let input_hash = plan.tile(&id).unwrap().input_hash.clone();
        let done = Done { input_hash, seconds: 7.0, files, splats: 11, ..Done::default() };
        done.write(&folder).unwrap();
    }

    /// The bands of a tile over its core and the overlap.
    pub(super) fn bands(&self, col: usize, row: usize) -> [Grid2; BANDS] {
        let (west, north) = self.start(col, row);
        let (width, height) = (self.columns[col] + 2 * OVERLAP, self.rows[row] + 2 * OVERLAP);
        let o = OVERLAP as i64;
        std::array::from_fn(|band| {
            Grid2::from_fn(width, height, |c, r| {
                (self.at)(col, row, west - o + c as i64, north - o + r as i64)[band]
            })
        })
    }
}

/// A number from 0 to 1 that depends on all of its arguments.
pub(super) fn noise(seed: u64, numbers: [i64; 4]) -> f32 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    numbers.iter().for_each(|n| {
        hasher.update(&n.to_le_bytes());
    });
    f32::from(u16::from_le_bytes([hasher.finalize().as_bytes()[0], hasher.finalize().as_bytes()[1]]))
        / 65535.0
}

/// A town: roofs of 8 m in a regular pattern, displaced by up to a cell from tile to tile, with holes and noise.
pub(super) fn town(seed: u64) -> impl Fn(usize, usize, i64, i64) -> [f32; BANDS] {
    move |tile_col, tile_row, col, row| {
        let (tc, tr) = (tile_col as i64, tile_row as i64);
        let n = |what: i64| noise(seed, [tc * 100 + tr, col, row, what]);
        let moved = col + (tc + tr) % 2;
        let roof = moved.rem_euclid(13) < 6 && row.rem_euclid(11) < 5;
        let height = if roof { 18.0 } else { 10.0 } + 0.2 * n(0) + 0.1 * (tc - tr) as f32;
        if n(1) < 0.03 {
            return [f32::NAN; BANDS];
        }
        let gray = (if roof { 180.0 } else { 90.0 } + 10.0 * n(2) + 5.0 * tc as f32).round();
        [height, gray, gray - 20.0, gray + 20.0, 0.5 + 0.5 * n(3), 0.3, 4.0 + tc as f32, 0.2]
    }
}
