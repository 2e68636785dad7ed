//! What is matched: the views and their pairs, the map grid, and the stack of planes over it.

use super::coverage::{ALTITUDES, Coverage};
use super::ground::Ground;
use super::image::MatchImage;
use super::pairs::stereo_pairs;
use crate::affine::{MIN_POINTS, SiteScene, TrainingView, median_pixel_m};
use crate::frame::{Point, Site, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::scene::views_needed;
use rayon::prelude::*;

/// Default side of a DSM's cells, metres. The map grid of the plane sweep has no smaller cells.
pub const DSM_CELL_M: f64 = 0.5;
/// Largest size of a cost volume, cells times planes, at three bytes each. For larger areas the cells are
/// made larger.
pub const MAX_VOLUME: f64 = 600e6;

/// Matching of a site's training views by plane sweep over a map grid; see the [module's page](super).
pub struct PlaneSweep {
    pub(super) site: SiteGrid,
    pub(super) grid: MapGrid,
    pub(super) images: Vec<MatchImage>,
    /// Pairs of images that are compared.
    pub(super) pairs: Vec<(usize, usize)>,
    pub(super) stack: PlaneStack,
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
    /// Number of planes.
    pub planes: usize,
}

impl PlaneStack {
    /// Distance from the lowest plane to the highest, metres.
    pub fn height_m(&self) -> f64 {
        f64::from(self.step) * (self.planes - 1) as f64
    }

    /// Altitude of a plane in a cell, site metres; fractions of planes interpolate.
    pub fn altitude(&self, cell: usize, plane: f32) -> f32 {
        self.ground.data[cell] + self.low + self.step * plane
    }
}

impl PlaneSweep {
    /// Prepares the matching of `views` over the area of a site. The range of altitudes is that of the sparse
    /// points `sparse`. Returns none if there are no sparse points or no two views make a stereo pair.
    ///
    /// Parts of a larger scene may have few points or none, over water for instance. Their range is that of the
    /// [frame](crate::affine::SiteFrame).
    #[must_use]
    pub fn new(setup: &SiteScene, views: &[TrainingView], sparse: &[Point<Site>]) -> Option<Self> {
        let pairs = stereo_pairs(views);
        if pairs.is_empty() {
            return None;
        }
        let images: Vec<MatchImage> = views.iter().map(MatchImage::new).collect();
        let are_few = setup.is_framed && sparse.len() < MIN_POINTS;
        let ground = Ground::new(if are_few { &[] } else { sparse }, setup.area);
        let (low, high) = if are_few { setup.altitudes } else { ground.heights_above(sparse)? };
        let (west, south, east, north) = setup.area;
        let [x, y, _] = setup.site.origin.xyz();
        let cell = cell_m(median_pixel_m(views));
        let volume = (east - west) * (north - south) * (high - low) / cell.powi(3);
        let cell = cell * (volume / MAX_VOLUME).cbrt().max(1.0);
        let grid = MapGrid::covering(setup.site.epsg, (x + west, y + south, x + east, y + north), cell);
        let ground = Grid2::from_fn(grid.width, grid.height, |col, row| {
            let p = setup.site.site_from_utm(grid.cell_center(col, row));
            ground.altitude(p.x(), p.y()) as f32
        });
        let planes = ((high - low) / cell).ceil() as usize + 2;
        let stack = PlaneStack { ground, low: low as f32, step: cell as f32, planes };
        let mut sweep = Self { site: setup.site, grid, images, pairs, stack, coverage: Vec::new() };
        sweep.coverage =
            (0..grid.width * grid.height).into_par_iter().map(|i| sweep.coverage_of(i)).collect();
        Some(sweep)
    }

    fn coverage_of(&self, cell: usize) -> Coverage {
        let (col, row) = (cell % self.grid.width, cell / self.grid.width);
        let views = |z: f32| self.covering_views(col, row, z);
        let step = (self.stack.planes - 1) as f32 / (ALTITUDES - 1) as f32;
        let counts = std::array::from_fn(|k| views(self.stack.altitude(cell, k as f32 * step)));
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
