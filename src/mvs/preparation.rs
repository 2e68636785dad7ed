//! Preparation of the matching: where the surface may lie, and the planes that are tested there.

use super::candidates::Candidates;
use super::coarse::candidates;
use super::ground::Ground;
use super::image::MatchImage;
use super::pairs::stereo_pairs;
use super::plane_ranges::{BlockAltitudes, PlaneRanges, planes_for};
use super::plane_sweep::{BLOCKS, MAX_VOLUME, PlaneStack, PlaneSweep, cell_m};
use crate::affine::{SiteScene, TrainingView, median_pixel_m};
use crate::frame::{Point, Site, SiteBox, SiteGrid};
use crate::io::{Grid2, MapGrid};
use rayon::prelude::*;
use std::ops::Range;

/// [`PlaneSweep::extra_pairs`] of the matching.
const EXTRA_PAIRS: f32 = 1.0;
/// Smallest factor by which cells are enlarged, so that a volume that is slightly too large needs few attempts.
const SMALLEST_ENLARGEMENT: f64 = 1.02;

impl PlaneSweep {
    /// Prepares the matching of `views` over the area of a site, between the altitudes that it searches. The ground, which the
    /// planes are parallel to, is estimated from the sparse points `sparse`. Returns none if no two views make a stereo pair.
    #[must_use]
    pub fn new(setup: &SiteScene, views: &[TrainingView], sparse: &[Point<Site>]) -> Option<Self> {
        let pairs = stereo_pairs(views);
        if pairs.is_empty() {
            return None;
        }
        let images: Vec<MatchImage> = views.iter().map(MatchImage::new).collect();
        let ground = Ground::new(sparse, setup.area);
        let pixel_m = median_pixel_m(views);
        let mut cell = cell_m(pixel_m);
        let candidates = candidates(setup, &images, &pairs, (sparse, &ground), (cell, pixel_m));
        let (west, south, east, north) = setup.area;
        let [x, y, _] = setup.site.origin.xyz();
        loop {
            let grid = MapGrid::covering(setup.site.epsg, (x + west, y + south, x + east, y + north), cell);
            let (stack, ranges) = planes(&setup.site, &grid, &ground, &candidates);
            let excess = ranges.volume() as f64 / MAX_VOLUME;
            if excess > 1.0 {
                cell *= excess.cbrt().max(SMALLEST_ENLARGEMENT);
                continue;
            }
            let sweep = Self::of_parts(setup.site, grid, images, pairs, stack, ranges);
            return Some(Self { extra_pairs: EXTRA_PAIRS, candidates: Some(candidates), ..sweep });
        }
    }
}

/// Height above and below a surface that is tested with it, metres.
const AROUND_SURFACE_M: f32 = 2.0;

impl PlaneSweep {
    /// Tests the altitudes of surfaces (site metres on this sweep's grid) as well. Training may have found what the coarse
    /// search did not, where the images have little texture for instance.
    pub(super) fn include(&mut self, surfaces: &[&Grid2]) {
        let (width, size) = (self.grid.width, (self.grid.width, self.grid.height));
        let (across, stack) = (BLOCKS.count(size).0, &self.stack);
        let before = self.ranges.blocks(BLOCKS);
        let margin = (AROUND_SURFACE_M / stack.step).ceil();
        // The planes of the surfaces in a block; negative below the lowest plane so far.
        let needed = |block: usize| {
            let columns = cells(block % across, BLOCKS.columns, size.0);
            let all = cells(block / across, BLOCKS.rows, size.1).flat_map(|row| {
                let of_row = columns.clone().map(move |col| row * width + col);
                of_row.flat_map(|cell| surfaces.iter().map(move |z| z.data[cell] - stack.altitude(cell, 0.0)))
            });
            let (low, high) = BlockAltitudes::bounds(all.filter(|above| !above.is_nan()));
            (low <= high).then(|| {
                let [low, high] = [low / stack.step - margin, high / stack.step + margin];
                (low.floor() as i64, high.ceil() as i64 + 1)
            })
        };
        let needed: Vec<Option<(i64, i64)>> = (0..before.len()).into_par_iter().map(needed).collect();
        let down =
            needed.iter().flatten().map(|(low, _)| *low).min().unwrap_or(0).min(0).unsigned_abs() as usize;
        let extended = |(range, needed): (&Range<usize>, &Option<(i64, i64)>)| {
            let range = range.start + down..range.end + down;
            let Some((low, high)) = needed.map(|(a, b)| (a + down as i64, b + down as i64)) else {
                return range;
            };
            let (low, high) = (low.max(0) as usize, high.max(0) as usize);
            if range.is_empty() { low..high } else { range.start.min(low)..range.end.max(high) }
        };
        let ranges: Vec<Range<usize>> = before.iter().zip(&needed).map(extended).collect();
        self.stack.low -= down as f32 * self.stack.step;
        self.ranges = PlaneRanges::of_blocks(size, BLOCKS, &ranges);
        let is_changed: Vec<bool> = before.iter().zip(&ranges).map(|(a, b)| a.len() != b.len()).collect();
        self.count_coverage(|col, row| is_changed[row / BLOCKS.rows * across + col / BLOCKS.columns]);
    }
}

/// The columns or rows of a block of so many, on a grid that has `count` of them.
fn cells(block: usize, side: usize, count: usize) -> Range<usize> {
    block * side..((block + 1) * side).min(count)
}

/// The planes over a map grid, and those that are tested in its cells: those near the candidates.
fn planes(
    site: &SiteGrid,
    grid: &MapGrid,
    ground: &Ground,
    candidates: &Candidates,
) -> (PlaneStack, PlaneRanges) {
    let size = (grid.width, grid.height);
    let ground = Grid2::from_fn(grid.width, grid.height, |col, row| {
        let p = site.site_from_utm(grid.cell_center(col, row));
        ground.altitude(p.x(), p.y()) as f32
    });
    let across = BLOCKS.count(size).0;
    let of_block = |block: usize| {
        let columns = cells(block % across, BLOCKS.columns, grid.width);
        let rows = cells(block / across, BLOCKS.rows, grid.height);
        let of_row = |row: usize| ground.row(row)[columns.clone()].iter().copied();
        BlockAltitudes {
            tested: candidates.altitudes(|_| box_of(site, grid, &columns, &rows)),
            ground: BlockAltitudes::bounds(rows.clone().flat_map(of_row)),
        }
    };
    let blocks: Vec<_> = (0..across * BLOCKS.count(size).1).into_par_iter().map(of_block).collect();
    let step = grid.cell as f32;
    let (low, _, ranges) = planes_for(&blocks, step);
    (PlaneStack { ground, low, step }, PlaneRanges::of_blocks(size, BLOCKS, &ranges))
}

/// The ground of columns and rows of a map grid, site metres.
fn box_of(site: &SiteGrid, grid: &MapGrid, columns: &Range<usize>, rows: &Range<usize>) -> SiteBox {
    let corner = |col: usize, row: usize| site.site_from_utm(grid.cell_center(col, row));
    let (upper, lower) = (corner(columns.start, rows.start), corner(columns.end - 1, rows.end - 1));
    (upper.x(), lower.y(), lower.x(), upper.y())
}
