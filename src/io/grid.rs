//! Map grids of rasters.

use crate::frame::{CornerPx, Pixel, Point, Utm};
use serde::{Deserialize, Serialize};

/// A north-up grid of square cells in a projected CRS in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapGrid {
    /// EPSG code of the CRS.
    pub epsg: u32,
    /// Easting of the western edge, metres.
    pub west: f64,
    /// Northing of the northern edge, metres.
    pub north: f64,
    /// Side of a cell, metres.
    pub cell: f64,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

impl MapGrid {
    /// The smallest grid that covers a box (west, south, east, north in metres) and whose edges are multiples of `cell`
    /// metres.
    #[must_use]
    pub fn covering(epsg: u32, (w, s, e, n): (f64, f64, f64, f64), cell: f64) -> Self {
        // A tolerance of a thousandth of a cell, so that a box with edges on the grid is not enlarged by rounding.
        let west = (w / cell + 1e-3).floor() * cell;
        let north = (n / cell - 1e-3).ceil() * cell;
        let width = ((e - west) / cell - 1e-3).ceil().max(1.0) as usize;
        let height = ((north - s) / cell - 1e-3).ceil().max(1.0) as usize;
        Self { epsg, west, north, cell, width, height }
    }

    /// Map position of a cell's centre at height 0.
    #[must_use]
    pub fn cell_center(&self, col: usize, row: usize) -> Point<Utm> {
        Point::new(
            self.west + (col as f64 + 0.5) * self.cell,
            self.north - (row as f64 + 0.5) * self.cell,
            0.0,
        )
    }

    /// Map position of the cell in the middle.
    #[must_use]
    pub fn middle(&self) -> Point<Utm> {
        self.cell_center(self.width / 2, self.height / 2)
    }

    /// Position of a map point in columns and rows; corners of cells are at whole numbers.
    #[must_use]
    pub fn corner_px_from_utm(&self, p: Point<Utm>) -> Pixel<CornerPx> {
        Pixel::new((p.x() - self.west) / self.cell, (self.north - p.y()) / self.cell)
    }

    /// The geotransform of GDAL.
    pub(super) fn geo_transform(&self) -> [f64; 6] {
        [self.west, self.cell, 0.0, self.north, 0.0, -self.cell]
    }

    /// Whether another grid has the same cells, with a tolerance of `slack` cells.
    #[must_use]
    pub fn is_same(&self, other: &Self, slack: f64) -> bool {
        let near = |a: f64, b: f64| (a - b).abs() <= slack * self.cell;
        let size = |g: &Self| (g.epsg, g.width, g.height);
        let (a, b) = (self.bounds(), other.bounds());
        size(self) == size(other) && near(a.0, b.0) && near(a.1, b.1) && near(a.2, b.2) && near(a.3, b.3)
    }

    /// The edges: west, south, east, north, metres.
    #[must_use]
    pub fn bounds(&self) -> (f64, f64, f64, f64) {
        (
            self.west,
            self.north - self.height as f64 * self.cell,
            self.west + self.width as f64 * self.cell,
            self.north,
        )
    }

    /// The bounds and the CRS, for messages.
    #[must_use]
    pub fn extent(&self) -> String {
        let (w, s, e, n) = self.bounds();
        format!("{w:.0}, {s:.0}, {e:.0}, {n:.0} of EPSG:{}", self.epsg)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covering_snaps_outwards_to_whole_cells() {
        let g = MapGrid::covering(32617, (10.2, 20.0, 14.9, 23.1), 0.5);
        assert_eq!((g.west, g.north, g.width, g.height), (10.0, 23.5, 10, 7));
        let same = MapGrid::covering(32617, g.bounds(), 0.5);
        assert_eq!(same, g);
    }
}
