//! Where the surface may lie: altitudes in the cells of a coarse grid.

use crate::affine::SiteScene;
use crate::frame::{Point, Site, SiteBox, SiteGrid};
use crate::io::MapGrid;
use rayon::prelude::*;
use std::ops::Range;

/// Height below and above the altitudes of the coarse cells, beside one coarse plane, that is searched at full resolution, metres: trees, chimneys
/// and light wells are too small for coarse cells.
const BELOW_M: f64 = 5.0;
const ABOVE_M: f64 = 8.0;
/// Bits of a word.
const WORD: usize = u64::BITS as usize;

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
    /// For every cell a bit for each plane, in words of 64: the candidates, and after [`Candidates::spread`] the planes near them.
    bits: Vec<u64>,
}

impl Candidates {
    /// No candidate yet in any cell of a grid, with planes from the lowest altitude on that a scene searches.
    pub fn none(setup: &SiteScene, grid: MapGrid, (step_m, planes): (f64, usize)) -> Self {
        let bits = vec![0; planes.div_ceil(WORD) * grid.width * grid.height];
        let (site, searched) = (setup.site, setup.searched);
        Self { site, grid, searched, low_m: searched.0, step_m, planes, bits }
    }

    /// The bits of every cell, one for each plane.
    pub fn bits_mut(&mut self) -> impl IndexedParallelIterator<Item = &mut [u64]> {
        let words = self.words();
        self.bits.par_chunks_mut(words)
    }

    /// Sets the planes near the candidates of a cell and of the cells around it.
    pub fn spread(&mut self) {
        let (below, above) = (self.planes_within(BELOW_M), self.planes_within(ABOVE_M));
        let (words, size) = (self.words(), (self.grid.width, self.grid.height));
        let mut near = vec![0; self.bits.len()];
        near.par_chunks_mut(words).enumerate().for_each(|(cell, near)| {
            for k in (0..self.planes).filter(|k| neighbourhood(cell, size).any(|cell| self.is_set(cell, *k)))
            {
                let planes = k.saturating_sub(below)..(k + above + 1).min(self.planes);
                planes.for_each(|k| near[k / WORD] |= 1 << (k % WORD));
            }
        });
        self.bits = near;
    }

    /// Lowest and highest altitude, site metres, between which the surface may lie in a part of the ground; none where no two
    /// views see it. `part` gives the part (site metres) at an altitude: that which a piece of an image shows, say.
    pub fn altitudes(&self, part: impl Fn(f64) -> SiteBox) -> Option<(f64, f64)> {
        let is_near = |k: &usize| {
            let (columns, rows) = self.cells(part(self.altitude(*k)));
            let mut cells = rows.flat_map(|row| columns.clone().map(move |col| row * self.grid.width + col));
            cells.any(|cell| self.is_set(cell, *k))
        };
        let lowest = (0..self.planes).find(is_near)?;
        let highest = (0..self.planes).rev().find(is_near)?;
        let (low, high) = (self.altitude(lowest) - self.step_m, self.altitude(highest) + self.step_m);
        Some((low.max(self.searched.0), high.min(self.searched.1)))
    }

    /// The altitudes at which the surface may lie at a place; the altitude of the place does not count.
    pub fn at(&self, place: Point<Site>) -> AltitudesAt<'_> {
        let (columns, rows) = self.cells((place.x(), place.y(), place.x(), place.y()));
        AltitudesAt { all: self, cell: rows.start * self.grid.width + columns.start }
    }

    /// Number of words of a cell.
    fn words(&self) -> usize {
        self.planes.div_ceil(WORD)
    }

    /// Whether the bit of a plane is set in a cell.
    fn is_set(&self, cell: usize, plane: usize) -> bool {
        self.bits[cell * self.words() + plane / WORD] >> (plane % WORD) & 1 == 1
    }

    /// Number of planes within so many metres of a coarse plane, and one more.
    fn planes_within(&self, metres: f64) -> usize {
        (metres / self.step_m) as usize + 1
    }

    /// Altitude of a coarse plane, site metres.
    fn altitude(&self, plane: usize) -> f64 {
        self.low_m + self.step_m * plane as f64
    }

    /// The columns and rows of the cells in a part of the ground, one at least.
    fn cells(&self, (west, south, east, north): SiteBox) -> (Range<usize>, Range<usize>) {
        let [x, y, _] = self.site.origin.xyz();
        let within = |from: f64, to: f64, n: usize| {
            let cell = |v: f64| (v / self.grid.cell).clamp(0.0, n as f64 - 1.0) as usize;
            cell(from)..cell(to) + 1
        };
        let columns = within(west + x - self.grid.west, east + x - self.grid.west, self.grid.width);
        (columns, within(self.grid.north - y - north, self.grid.north - y - south, self.grid.height))
    }
}

/// The altitudes at which the surface may lie in a cell.
pub(super) struct AltitudesAt<'a> {
    all: &'a Candidates,
    cell: usize,
}

impl AltitudesAt<'_> {
    /// Whether the surface may lie at an altitude, site metres.
    pub fn contains(&self, altitude: f64) -> bool {
        let Candidates { low_m, step_m, planes, .. } = self.all;
        let plane = ((altitude - low_m) / step_m).round().clamp(0.0, *planes as f64 - 1.0);
        self.all.is_set(self.cell, plane as usize)
    }
}

/// The cells of the square of nine around a cell of a grid.
pub(super) fn neighbourhood(
    cell: usize,
    (width, height): (usize, usize),
) -> impl Iterator<Item = usize> + Clone {
    let near = |v: usize, n: usize| v.saturating_sub(1)..(v + 2).min(n);
    let columns = near(cell % width, width);
    near(cell / width, height).flat_map(move |row| columns.clone().map(move |col| row * width + col))
}
