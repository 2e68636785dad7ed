//! Connected regions of cells that rose, or fell.

use super::outline::outline;
use crate::io::{Grid2, MapGrid, box_openings};
use crate::stats::quantile;
use serde::Serialize;

/// Radius of the squares that a region must hold, metres: edges of roofs that two surfaces have a pixel apart are narrower.
const OPENING_M: f64 = 1.0;
/// A cell changed if its difference is so many standard deviations.
const CELL_SIGMAS: f32 = 2.0;
/// A region changed if its mean difference is so many times the median of the standard deviations of its cells, which err together.
/// The limit is high because errors beside trees and walls have long tails: in a simulated town houses that were built or torn down
/// have 27 to 81, and what only looks different between trees has 8.
const REGION_SIGMAS: f64 = 15.0;

/// What counts as a change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionRule {
    /// Smallest difference of heights, metres.
    pub least_height_m: f64,
    /// Smallest area of a region, square metres.
    pub least_area_m2: f64,
}

impl Default for RegionRule {
    /// Half a storey, and a garage.
    fn default() -> Self {
        Self { least_height_m: 1.5, least_area_m2: 25.0 }
    }
}

/// A region that changed.
#[derive(Clone, Debug, Serialize)]
pub struct Region {
    /// Area, square metres.
    pub area_m2: f64,
    /// Mean difference of heights, metres: positive where the surface rose.
    pub mean_m: f64,
    /// Difference of heights that is largest in size, metres.
    pub largest_m: f64,
    /// Volume between the surfaces, cubic metres: positive where the surface rose.
    pub volume_m3: f64,
    /// Standard deviation of the volume, cubic metres, if the cells of the region err together.
    pub volume_sigma_m3: f64,
    /// Corners of the outline on the map, (east, north); holes are not cut out, the first corner is not repeated.
    #[serde(skip)]
    pub outline: Vec<(f64, f64)>,
    /// Indices of its cells.
    #[serde(skip)]
    pub cells: Vec<usize>,
}

/// The regions of a map of differences with their standard deviations, the largest volume first. `cell_m` is the side of a cell on
/// the ground, metres.
pub(super) fn regions(
    difference: &Grid2,
    sigma: &Grid2,
    (grid, cell_m): (&MapGrid, f64),
    rule: &RegionRule,
) -> Vec<Region> {
    let radius = (OPENING_M / cell_m).round().max(1.0) as usize;
    let mut out = Vec::new();
    for sign in [1.0, -1.0] {
        let changed = |(d, s): (&f32, &f32)| {
            let is_changed = sign * d >= (rule.least_height_m as f32).max(CELL_SIGMAS * s);
            f32::from(u8::from(is_changed))
        };
        let data = difference.data.iter().zip(&sigma.data).map(changed).collect();
        let wide = box_openings(&Grid2 { data, ..*difference }, radius);
        for cells in connected(&wide) {
            let sigmas = cells.iter().map(|cell| f64::from(sigma.data[*cell])).filter(|s| !s.is_nan());
            let usual_sigma_m = quantile(sigmas.collect(), 0.5).unwrap_or(f64::INFINITY);
            let region = region(difference, sigma, cells, (grid, cell_m));
            let is_sure = region.mean_m.abs() >= REGION_SIGMAS * usual_sigma_m;
            if region.area_m2 >= rule.least_area_m2 && is_sure {
                out.push(region);
            }
        }
    }
    out.sort_by(|a, b| b.volume_m3.abs().total_cmp(&a.volume_m3.abs()));
    out
}

fn region(difference: &Grid2, sigma: &Grid2, cells: Vec<usize>, (grid, cell_m): (&MapGrid, f64)) -> Region {
    let values = || cells.iter().map(|cell| f64::from(difference.data[*cell])).filter(|d| !d.is_nan());
    let known = values().count().max(1) as f64;
    let mean_m = values().sum::<f64>() / known;
    let variances = cells.iter().map(|cell| f64::from(sigma.data[*cell]).powi(2)).filter(|v| !v.is_nan());
    let sigma_m = (variances.sum::<f64>() / known).sqrt();
    let area_m2 = cells.len() as f64 * cell_m * cell_m;
    Region {
        area_m2,
        mean_m,
        largest_m: values().fold(0.0, |a, b| if b.abs() > f64::abs(a) { b } else { a }),
        volume_m3: mean_m * area_m2,
        volume_sigma_m3: sigma_m * area_m2,
        outline: outline(&cells, grid),
        cells,
    }
}

/// Cells above zero that are connected along their sides, in the order of their first cells.
fn connected(mask: &Grid2) -> Vec<Vec<usize>> {
    let (width, height) = (mask.width, mask.height);
    let mut is_left: Vec<bool> = mask.data.iter().map(|v| *v > 0.0).collect();
    let mut out = Vec::new();
    for first in 0..is_left.len() {
        if !std::mem::take(&mut is_left[first]) {
            continue;
        }
        let (mut cells, mut next) = (vec![first], 0);
        while let Some(&cell) = cells.get(next) {
            next += 1;
            let (col, row) = (cell % width, cell / width);
            let beside = [
                (col > 0).then(|| cell - 1),
                (col + 1 < width).then_some(cell + 1),
                (row > 0).then(|| cell - width),
                (row + 1 < height).then_some(cell + width),
            ];
            for other in beside.into_iter().flatten() {
                if std::mem::take(&mut is_left[other]) {
                    cells.push(other);
                }
            }
        }
        cells.sort_unstable();
        out.push(cells);
    }
    out
}
