//! The exact surface of a simulated town.

use crate::frame::SiteGrid;
use crate::io::{Grid2, MapGrid};
use crate::mvs::MatchedSurface;

/// Neighbouring cells of a smooth part of the surface differ by less, metres.
const SMOOTH_M: f32 = 0.5;

/// The exact surface: altitudes, metres above the site's origin, on a map grid.
pub struct ExactSurface {
    site: SiteGrid,
    grid: MapGrid,
    /// Altitudes.
    pub altitude: Grid2,
}

impl ExactSurface {
    /// The surface on a map grid.
    pub fn new(site: SiteGrid, grid: MapGrid, altitude: Grid2) -> Self {
        Self { site, grid, altitude }
    }

    /// Side of a cell, metres.
    pub fn cell_m(&self) -> f64 {
        self.grid.cell
    }

    /// Level position of the centre of a cell, site metres.
    pub fn center(&self, col: usize, row: usize) -> [f64; 2] {
        let p = self.site.site_from_utm(self.grid.cell_center(col, row));
        [p.x(), p.y()]
    }

    /// A point at the centre of each cell.
    pub fn points(&self) -> Vec<[f64; 3]> {
        let at = |i: usize| {
            let (col, row) = (i % self.altitude.width, i / self.altitude.width);
            let [x, y] = self.center(col, row);
            [x, y, f64::from(self.altitude.at(col, row))]
        };
        (0..self.altitude.data.len()).map(at).collect()
    }

    /// The surface with a weight of one where it is smooth.
    pub fn smooth_parts(&self) -> MatchedSurface {
        let (width, height) = (self.altitude.width, self.altitude.height);
        let weight = Grid2::from_fn(width, height, |col, row| {
            let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (col as i64 + dx, row as i64 + dy)));
            let z = self.altitude.at(col, row);
            let is_smooth = around.map(|(c, r)| self.altitude.get(c, r)).all(|v| (v - z).abs() < SMOOTH_M);
            f32::from(u8::from(is_smooth))
        });
        MatchedSurface {
            site: self.site,
            grid: self.grid,
            altitude: self.altitude.clone(),
            score: weight.clone(),
            prior_weight: weight,
        }
    }
}
