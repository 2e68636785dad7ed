//! Where the surface may lie: altitudes in the cells of a coarse grid.

use crate::affine::SiteScene;
use crate::frame::{SiteBox, SiteGrid};
use crate::io::MapGrid;
use rayon::prelude::*;
use std::ops::Range;

/// Height below and above the altitudes of the coarse cells that is searched at full resolution, metres: trees, chimneys
/// and light wells are too small for coarse cells.
const BELOW_M: f64 = 5.0;
const ABOVE_M: f64 = 8.0;

/// Altitudes at which the surface may lie, in every cell of a coarse grid.
pub(super) struct Candidates {
    site: SiteGrid,
    grid: MapGrid,
    /// Lowest and highest altitude that is searched, site metres.
    searched: (f64, f64),
    /// Altitude of the lowest coarse plane, and the distance between planes, metres.
    low_m: f64,
    step_m: f64,
    planes: usize,
    /// For every cell a bit for each plane, in words of 64.
    bits: Vec<u64>,
}

impl Candidates {
    /// No candidate yet in any cell of a grid, with planes from the lowest altitude on that a scene searches.
    pub fn none(setup: &SiteScene, grid: MapGrid, (step_m, planes): (f64, usize)) -> Self {
        let bits = vec![0; planes.div_ceil(u64::BITS as usize) * grid.width * grid.height];
        let (site, searched) = (setup.site, setup.searched);
        Self { site, grid, searched, low_m: searched.0, step_m, planes, bits }
    }

    /// The bits of every cell, one for each plane.
    pub fn bits_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [u64]> {
        let words = self.planes.div_ceil(u64::BITS as usize);
        self.bits.par_chunks_mut(words)
    }

    /// Lowest and highest altitude, site metres, between which the surface may lie in a part of the ground, with margins; none
    /// where no two views see it. `part` gives the part (site metres) at an altitude: that which a piece of an image shows,
    /// say.
    pub fn altitudes(&self, part: impl Fn(f64) -> SiteBox) -> Option<(f64, f64)> {
        let is_candidate = |k: &usize| {
            let (columns, rows) = self.cells(part(self.altitude(*k)));
            let words = self.planes.div_ceil(64);
            let mut cells = rows.flat_map(|row| columns.clone().map(move |col| row * self.grid.width + col));
            cells.any(|cell| self.bits[cell * words + k / 64] >> (k % 64) & 1 == 1)
        };
        let lowest = (0..self.planes).find(is_candidate)?;
        let highest = (0..self.planes).rev().find(is_candidate)?;
        let low = self.altitude(lowest) - self.step_m - BELOW_M;
        let high = self.altitude(highest) + self.step_m + ABOVE_M;
        Some((low.max(self.searched.0), high.min(self.searched.1)))
    }

    /// Altitude of a coarse plane, site metres.
    fn altitude(&self, plane: usize) -> f64 {
        self.low_m + self.step_m * plane as f64
    }

    /// The columns and rows of the cells in a part of the ground, and of those around them.
    fn cells(&self, (west, south, east, north): SiteBox) -> (Range<usize>, Range<usize>) {
        let [x, y, _] = self.site.origin.xyz();
        let within = |from: f64, to: f64, n: usize| {
            let cell = |v: f64| (v / self.grid.cell).floor().clamp(-2.0, n as f64 + 1.0) as i64;
            let (first, last) = (cell(from) - 1, cell(to) + 1);
            first.clamp(0, n as i64) as usize..(last + 1).clamp(0, n as i64) as usize
        };
        let columns = within(west + x - self.grid.west, east + x - self.grid.west, self.grid.width);
        (columns, within(self.grid.north - y - north, self.grid.north - y - south, self.grid.height))
    }
}
