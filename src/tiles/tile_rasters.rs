//! The rasters of a complete tile, of which windows are read.

use super::TilesError;
use super::cells::Cells;
use super::cut::BANDS;
use super::done::{Done, tile_folder};
use super::plan::{Plan, Tile};
use crate::io::{Grid2, ImageFile};
use crate::run_files::{CONFIDENCE, DONE, DSM, ORTHO};
use std::path::Path;

/// The three rasters of a tile, and its `done.json`.
pub(super) struct TileRasters {
    /// ID of the tile.
    pub(super) id: String,
    /// What the tile was made from.
    pub(super) done: Done,
    /// Surface model, orthophoto and confidence.
    pub(super) files: [ImageFile; 3],
    cells: Cells,
}

/// Blended bands over a box of cells.
pub(super) struct Patch {
    pub(super) cells: Cells,
    /// Height, red, green, blue, opacity, spread, views, expected error: NaN where there is none.
    pub(super) bands: [Grid2; BANDS],
    /// The weight of the tile of the neighbouring column, from 0 to 1.
    pub(super) share: Grid2,
}

impl TileRasters {
    /// Opens the rasters of a tile.
    ///
    /// # Errors
    /// [`TilesError::NotDone`], or [`TilesError::Grid`] if a raster does not have the tile's grid.
    pub(super) fn open(run: &Path, plan: &Plan, tile: &Tile) -> Result<Self, TilesError> {
        let folder = tile_folder(run, &tile.id);
        let done = Done::of_tile(run, tile)
            .ok_or_else(|| TilesError::NotDone { id: tile.id.clone(), file: folder.join(DONE) })?;
        let grid = plan.overlap_grid(tile);
        let open = |name: &str| {
            let file = ImageFile::open(&folder.join(name))?;
            if !file.map_grid()?.is_same(&grid, 1e-3) {
                return Err(TilesError::Grid { id: tile.id.clone(), file: file.path().into() });
            }
            Ok(file)
        };
        let files = [open(DSM)?, open(ORTHO)?, open(CONFIDENCE)?];
        let overlap = plan.overlap_cells();
        Ok(Self {
            id: tile.id.clone(),
            done,
            files,
            cells: Cells::of_box(tile.core, plan.resolution_m).grown(overlap),
        })
    }

    /// Reads one of the [`BANDS`] bands over a box; NaN outside of the tile.
    pub(super) fn read(&self, band: usize, cells: Cells) -> Result<Grid2, TilesError> {
        let mut out = Grid2::filled(cells.width(), cells.height(), f32::NAN);
        let Some(common) = cells.common(self.cells) else { return Ok(out) };
        // The surface model has one band, the orthophoto three, the confidence the others.
        let (file, index) = match band {
            0 => (0, 1),
            1..4 => (1, band),
            _ => (2, band - 3),
        };
        let read = self.files[file].read_window(index, common.window_in(self.cells))?;
        let to = common.window_in(cells);
        for row in 0..to.height {
            let start = (to.row + row) * out.width + to.col;
            out.data[start..start + to.width].copy_from_slice(read.row(row));
        }
        Ok(out)
    }

    /// Reads all bands over a box.
    pub(super) fn read_all(&self, cells: Cells) -> Result<[Grid2; BANDS], TilesError> {
        let mut bands = std::array::from_fn(|_| Grid2::filled(0, 0, f32::NAN));
        for (band, grid) in bands.iter_mut().enumerate() {
            *grid = self.read(band, cells)?;
        }
        Ok(bands)
    }
}

impl Patch {
    /// A patch without data.
    pub(super) fn empty(cells: Cells) -> Self {
        let none = Grid2::filled(cells.width(), cells.height(), f32::NAN);
        let share = Grid2::filled(cells.width(), cells.height(), 0.0);
        Self { cells, bands: std::array::from_fn(|_| none.clone()), share }
    }

    /// All bands of a cell.
    pub(super) fn at(&self, cell: usize) -> [f32; BANDS] {
        std::array::from_fn(|i| self.bands[i].data[cell])
    }
}
