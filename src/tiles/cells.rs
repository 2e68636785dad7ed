//! Boxes of cells: all tiles share one grid, so that only whole numbers of cells separate them.

use crate::io::{MapGrid, Window};

/// A box on the map: west, south, east, north, metres of the plan's UTM zone. Its edges are multiples of the cell.
pub type MapBox = [f64; 4];

/// A box of cells, counted east and south from the origin of the map projection; its ends are excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cells {
    /// First column.
    pub(super) west: i64,
    /// First row.
    pub(super) north: i64,
    /// Column after the last.
    pub(super) east: i64,
    /// Row after the last.
    pub(super) south: i64,
}

impl Cells {
    /// The cells of a box on the map.
    pub(super) fn of_box([w, s, e, n]: MapBox, cell_m: f64) -> Self {
        let count = |v: f64| (v / cell_m).round() as i64;
        Self { west: count(w), north: -count(n), east: count(e), south: -count(s) }
    }

    /// All cells within a distance in cells.
    pub(super) fn grown(self, cells: i64) -> Self {
        Self {
            west: self.west - cells,
            north: self.north - cells,
            east: self.east + cells,
            south: self.south + cells,
        }
    }

    /// Number of columns.
    pub(super) fn width(self) -> usize {
        (self.east - self.west).max(0) as usize
    }

    /// Number of rows.
    pub(super) fn height(self) -> usize {
        (self.south - self.north).max(0) as usize
    }

    /// The cells in both boxes; none if there are none.
    pub(super) fn common(self, other: Self) -> Option<Self> {
        let both = Self {
            west: self.west.max(other.west),
            north: self.north.max(other.north),
            east: self.east.min(other.east),
            south: self.south.min(other.south),
        };
        (both.west < both.east && both.north < both.south).then_some(both)
    }

    /// The place of this box in a larger one.
    pub(super) fn window_in(self, outer: Self) -> Window {
        Window {
            col: (self.west - outer.west) as usize,
            row: (self.north - outer.north) as usize,
            width: self.width(),
            height: self.height(),
        }
    }

    /// The map grid of the box.
    pub(super) fn grid(self, epsg: u32, cell_m: f64) -> MapGrid {
        MapGrid {
            epsg,
            west: self.west as f64 * cell_m,
            north: -self.north as f64 * cell_m,
            cell: cell_m,
            width: self.width(),
            height: self.height(),
        }
    }
}
