//! Where the surface may lie: a sweep at low resolution over all heights that are searched.
//!
//! Tie points are few and bound nothing: none may lie on a tower or in a pit. The views are therefore first compared at a
//! fraction of their resolution over the whole range of heights, which takes a few percent of the time of matching. Each
//! coarse cell keeps all altitudes at which the surface may lie: that of semi-global matching, which prefers surfaces without
//! steps, and every other one at which the views agree better. Only near these are the views compared at full resolution.

use super::candidates::{Candidates, neighbourhood};
use super::correlation::CostVolume;
use super::ground::Ground;
use super::image::MatchImage;
use super::plane_ranges::PlaneRanges;
use super::plane_sweep::{PlaneStack, PlaneSweep};
use super::semiglobal::{self, P2, Penalties};
use crate::affine::{MIN_POINTS, SiteScene};
use crate::frame::{Point, Site};
use crate::io::{Grid2, MapGrid};
use crate::stats::quantile;
use rayon::prelude::*;
use std::ops::Range;

/// Factor by which the images are reduced, and by which coarse cells are larger than fine ones: a tower eight pixels wide
/// still covers some cells.
const REDUCTION: usize = 4;
/// Largest size of the volume of the coarse cells, cells times planes, at four bytes each; for more, the cells are larger.
const MOST_VOLUME: f64 = 100e6;
/// Largest distance between the coarse planes, coarse cells.
const MOST_STEP_CELLS: f64 = 2.0;
/// Penalties of semi-global matching on the coarse grid, where 255 stands for a correlation of 0. The larger one is low,
/// because a tower covers few cells.
const P1: u16 = 20;
const P2_COARSE: u16 = 80;
/// An altitude at which the views agree better than at that of semi-global matching, by this cost, is kept as well, if its own
/// cost is at most the second one: a mean cube of correlations of 0.3. Costs are means over 3 x 3 cells, because single cells
/// agree by chance.
const BETTER_BY: u8 = 20;
const MOST_COST: u8 = 178;
/// Cost from which the altitude of semi-global matching is no evidence: where the views agree less, the planes of the tie points are
/// tested instead.
const WEAK_COST: u8 = 150;
/// Quantiles of the heights of the tie points above the ground, and the height above them, between which most surfaces lie: searched
/// where the views hardly agree, because there is little texture at the low resolution.
const USUAL: (f64, f64) = (0.005, 0.995);
const USUAL_ABOVE_M: f64 = 7.0;
/// Such an altitude must be found in so many of the nine cells around, up to one plane higher or lower.
const LEAST_SUPPORT: usize = 4;

/// Searches the altitudes of a scene with pairs of images, whose pixels have `pixel_m` metres, to match cells of
/// `cell_m` metres.
pub(super) fn candidates(
    setup: &SiteScene,
    images: &[MatchImage],
    pairs: &[(usize, usize)],
    (sparse, ground): (&[Point<Site>], &Ground),
    (cell_m, pixel_m): (f64, f64),
) -> Candidates {
    let searched = setup.searched;
    let (west, south, east, north) = setup.area;
    let [x, y, _] = setup.site.origin.xyz();
    let slopes: Vec<[f64; 2]> = images.iter().map(|i| i.camera.line_of_sight_slope()).collect();
    let parallax =
        |&(i, j): &(usize, usize)| (slopes[i][0] - slopes[j][0]).hypot(slopes[i][1] - slopes[j][1]);
    let widest = pairs.iter().map(parallax).fold(0.0, f64::max);
    let step_cells = widest.recip().clamp(1.0, MOST_STEP_CELLS);
    let range_m = (searched.1 - searched.0).max(0.0);
    let coarse_m = REDUCTION as f64 * cell_m;
    let volume = (east - west) * (north - south) * range_m / (coarse_m.powi(3) * step_cells);
    let coarse_m = coarse_m * (volume / MOST_VOLUME).cbrt().max(1.0);
    let grid = MapGrid::covering(setup.site.epsg, (x + west, y + south, x + east, y + north), coarse_m);
    let step_m = step_cells * coarse_m;
    let planes = (range_m / step_m).ceil() as usize + 1;
    let factor = (coarse_m / pixel_m).max(1.0) as usize;
    let images: Vec<MatchImage> = images.par_iter().map(|image| image.reduced(factor)).collect();
    let size = (grid.width, grid.height);
    let stack = PlaneStack {
        ground: Grid2::filled(grid.width, grid.height, 0.0),
        low: searched.0 as f32,
        step: step_m as f32,
    };
    let ranges = PlaneRanges::uniform(size, planes);
    let sweep = PlaneSweep::of_parts(setup.site, grid, images, pairs.to_vec(), stack, ranges);
    let costs = CostVolume::correlate(&sweep, None);
    let mut out = Candidates::none(setup, grid, (step_m, planes));
    let plane =
        |altitude: f64| (((altitude - searched.0) / step_m).round().max(0.0) as usize).min(planes - 1);
    let above: Vec<f64> = sparse.iter().map(|p| p.z() - ground.altitude(p.x(), p.y())).collect();
    let bound = |share: f64| quantile(above.clone(), share);
    let usual_m = bound(USUAL.0).zip(bound(USUAL.1)).filter(|_| sparse.len() >= MIN_POINTS);
    let usual = |cell: usize| {
        let p = setup.site.site_from_utm(grid.cell_center(cell % size.0, cell / size.0));
        let ground = ground.altitude(p.x(), p.y());
        let (low, high) =
            usual_m.map_or(setup.altitudes, |(low, high)| (ground + low, ground + high + USUAL_ABOVE_M));
        plane(low)..plane(high) + 1
    };
    mark(&mut out, &costs.costs, (size, planes), usual);
    out.spread();
    out
}

/// The planes at which the surface may lie in a cell.
#[derive(Default)]
struct CellPlanes {
    /// That of semi-global matching.
    best: Option<usize>,
    /// Those at which the views agree better.
    better: Vec<usize>,
    /// Those of the tie points, where the views hardly agree.
    usual: Range<usize>,
}

/// Marks the candidates of all cells of a coarse grid by the costs of its planes. Where the views hardly agree on an altitude, these
/// include the `usual` planes.
fn mark(
    candidates: &mut Candidates,
    costs: &[u8],
    (size, planes): ((usize, usize), usize),
    usual: impl Fn(usize) -> Range<usize> + Sync,
) {
    let penalties = Penalties { p1: P1, p2: P2::Constant(P2_COARSE) };
    let sums = semiglobal::aggregate(costs, &PlaneRanges::uniform(size, planes), penalties);
    let smooth = means(costs, size, planes);
    let of_cell = |cell: usize| {
        let own = cell * planes..(cell + 1) * planes;
        if costs[own.clone()].iter().all(|c| *c == CostVolume::UNSEEN) {
            return CellPlanes::default();
        }
        let (sums, smooth) = (&sums[own.clone()], &smooth[own]);
        let best = (0..planes).min_by_key(|k| sums[*k]).filter(|k| smooth[*k] <= WEAK_COST);
        let usual = if best.is_none() { usual(cell) } else { 0..0 };
        let reference = best.or_else(|| usual.clone().min_by_key(|k| smooth[*k]));
        let limit = reference.map_or(MOST_COST, |k| smooth[k].saturating_sub(BETTER_BY).min(MOST_COST));
        let at = |k: usize| smooth.get(k).copied().unwrap_or(CostVolume::UNSEEN);
        let is_least = |k: usize| at(k) <= at(k + 1) && (k == 0 || at(k) < at(k - 1));
        let better = (0..planes).filter(|k| at(*k) <= limit && is_least(*k)).collect();
        CellPlanes { best, better, usual }
    };
    let found: Vec<CellPlanes> = (0..size.0 * size.1).into_par_iter().map(of_cell).collect();
    candidates.bits_mut().enumerate().for_each(|(cell, bits)| {
        let mut set = |k: usize| bits[k / 64] |= 1 << (k % 64);
        let CellPlanes { best, better, usual } = &found[cell];
        best.iter().copied().chain(usual.clone()).for_each(&mut set);
        let around = neighbourhood(cell, size);
        let supports = |k: usize, cell: usize| {
            let CellPlanes { best, better, .. } = &found[cell];
            best.iter().chain(better).any(|other| other.abs_diff(k) <= 1)
        };
        for k in better {
            if around.clone().filter(|cell| supports(*k, *cell)).count() >= LEAST_SUPPORT {
                set(*k);
            }
        }
    });
}

/// Means of the costs of each plane over the cells around that are seen.
fn means(costs: &[u8], size: (usize, usize), planes: usize) -> Vec<u8> {
    let mut out = vec![CostVolume::UNSEEN; costs.len()];
    out.par_chunks_mut(planes).enumerate().for_each_init(
        || vec![(0u16, 0u16); planes],
        |sums, (cell, out)| {
            sums.fill((0, 0));
            for other in neighbourhood(cell, size) {
                let costs = &costs[other * planes..(other + 1) * planes];
                for ((sum, count), cost) in sums.iter_mut().zip(costs) {
                    let seen = u16::from(*cost != CostVolume::UNSEEN);
                    *sum += seen * u16::from(*cost);
                    *count += seen;
                }
            }
            for (out, (sum, count)) in out.iter_mut().zip(sums.iter()).filter(|(_, (_, count))| *count > 0) {
                *out = (sum / count) as u8;
            }
        },
    );
    out
}
