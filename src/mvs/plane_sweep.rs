//! What is matched: the views and their pairs, the map grid, and the stack of planes over it.

use super::candidates::Candidates;
use super::coverage::{ALTITUDES, Coverage};
use super::image::MatchImage;
use super::plane_ranges::{Blocks, PlaneRanges};
use crate::frame::SiteGrid;
use crate::io::{Grid2, MapGrid};
use crate::scene::views_needed;
use rayon::prelude::*;

/// Default side of a DSM's cells, metres. The map grid of the plane sweep has no smaller cells.
pub const DSM_CELL_M: f64 = 0.5;
/// Largest size of a cost volume, cells times planes, at three bytes each. For larger areas the cells are
/// made larger.
pub const MAX_VOLUME: f64 = 600e6;
/// Blocks of the grid with a common range of planes.
pub(super) const BLOCKS: Blocks = Blocks { columns: 62, rows: 16 };

/// Matching of a site's training views by plane sweep over a map grid; see the [module's page](super).
pub struct PlaneSweep {
    pub(super) site: SiteGrid,
    pub(super) grid: MapGrid,
    pub(super) images: Vec<MatchImage>,
    /// Pairs of images that are compared.
    pub(super) pairs: Vec<(usize, usize)>,
    pub(super) stack: PlaneStack,
    /// The planes that are tested in every cell.
    pub(super) ranges: PlaneRanges,
    /// Number of imaginary pairs with a correlation of 0 that is added to the pairs of every cell: it lowers the
    /// score of cells that few pairs see.
    pub(super) extra_pairs: f32,
    /// Where the surface may lie; none for the sweep that finds this.
    pub(super) candidates: Option<Candidates>,
    /// For every cell of the grid, row by row.
    pub(super) coverage: Vec<Coverage>,
}

/// Surfaces parallel to the ground: plane `k` lies `low + k * step` metres above it.
pub(super) struct PlaneStack {
    /// Altitude of the ground in every cell, site metres.
    pub ground: Grid2,
    /// Height of the lowest plane above the ground, metres.
    pub low: f32,
    /// Distance between planes, metres.
    pub step: f32,
}

impl PlaneStack {
    /// Altitude of a plane in a cell, site metres; fractions of planes interpolate.
    pub fn altitude(&self, cell: usize, plane: f32) -> f32 {
        self.ground.data[cell] + self.low + self.step * plane
    }
}

impl PlaneSweep {
    /// A sweep of its parts, without imaginary pairs.
    pub(super) fn of_parts(
        site: SiteGrid,
        grid: MapGrid,
        images: Vec<MatchImage>,
        pairs: Vec<(usize, usize)>,
        stack: PlaneStack,
        ranges: PlaneRanges,
    ) -> Self {
        let coverage = vec![Coverage::default(); grid.width * grid.height];
        let mut sweep =
            Self { site, grid, images, pairs, stack, ranges, extra_pairs: 0.0, candidates: None, coverage };
        sweep.count_coverage(|_, _| true);
        sweep
    }

    /// Counts the images that cover the cells for which this holds.
    pub(super) fn count_coverage(&mut self, is_counted: impl Fn(usize, usize) -> bool + Sync) {
        let width = self.grid.width;
        let mut coverage = std::mem::take(&mut self.coverage);
        let cells = coverage.par_iter_mut().enumerate();
        let counted = cells.filter(|(i, _)| is_counted(i % width, i / width));
        counted.for_each(|(i, out)| *out = self.coverage_of(i));
        self.coverage = coverage;
    }

    fn coverage_of(&self, cell: usize) -> Coverage {
        let (col, row) = (cell % self.grid.width, cell / self.grid.width);
        let views = |z: f32| self.covering_views(col, row, z);
        let planes = self.ranges.planes(cell);
        let step = planes.len().saturating_sub(1) as f32 / (ALTITUDES - 1) as f32;
        let plane = |k: usize| planes.start as f32 + k as f32 * step;
        let counts = std::array::from_fn(|k| views(self.stack.altitude(cell, plane(k))));
        Coverage::new(views(self.stack.ground.data[cell]), counts, views_needed(self.images.len()))
    }

    /// Number of images onto whose valid pixels the centre of a cell projects at an altitude.
    pub(super) fn covering_views(&self, col: usize, row: usize, altitude: f32) -> usize {
        let p = self.site.site_from_utm(self.grid.cell_center(col, row)).at_height(f64::from(altitude));
        self.images.iter().filter(|i| i.covers(p)).count()
    }

    /// The map grid of the matched surface.
    #[must_use]
    pub fn grid(&self) -> MapGrid {
        self.grid
    }
}

/// Side of the grid's cells, metres, for pixels of `pixel_m` metres: the pixel size rounded to a tenth of a
/// metre, at least [`DSM_CELL_M`]. Pixels of about half a metre thus give the default cells of the DSM, which
/// then needs no resampling.
pub fn cell_m(pixel_m: f64) -> f64 {
    ((10.0 * pixel_m).round() / 10.0).max(DSM_CELL_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_as_wide_as_pixels_but_not_smaller_than_those_of_the_dsm() {
        assert_eq!([0.31, 0.515, 0.702].map(cell_m), [0.5, 0.5, 0.7]);
    }
}
