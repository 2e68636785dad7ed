//! The translation that brings points to a height raster.

use super::error::{CoregisterError, FEWEST, REACH_M};
use super::shift::{Coregistration, Shift};
use crate::frame::{Point, Transform, Utm};
use crate::io::Grid2;
use crate::metrics::{
    HeightRaster, PatternSearch, STENCIL, ShiftPrecision, block_costs, block_of, is_rival, median_sigma,
};
use crate::stats::interpolated_quantile;
use rayon::prelude::*;

/// Step of the grid of shifts, metres.
const STEP_M: f64 = 1.5;
/// Last step of the refinement, metres.
const FINEST_M: f64 = 1e-3;
/// Number of points that are evaluated for every shift of the grid, and during the refinement.
const SCREENED: usize = 4_000;
const REFINED: usize = 60_000;
/// Number of shifts of the grid that are refined, because the differences have several minima; and largest number of
/// grids, each around the best shift so far.
const STARTS: usize = 6;
const ROUNDS: usize = 5;
/// Half the side and step of the last grid, around the best shift, metres: few points have minima that are close to each other.
const NEAR_M: f64 = 2.0;
const NEAR_STEP_M: f64 = 0.25;
/// Differences of heights are clipped at this, metres.
const CLIP_M: f32 = 3.0;
/// A direction whose standard deviation is below this is determined, metres; others only by shifts that are several times theirs.
const FINE_M: f64 = 0.5;
/// Smallest fraction of the most points that any shift has on the reference.
const LEAST_SHARE: f64 = 0.5;

/// The translation of points, whose map has the code EPSG `epsg`, to a height raster.
///
/// # Errors
/// [`CoregisterError::NoOverlap`], [`CoregisterError::TooFar`], [`CoregisterError::Frame`].
pub fn to_surface(
    points: &[Point<Utm>],
    epsg: u32,
    reference: &HeightRaster,
) -> Result<Coregistration, CoregisterError> {
    let mut search = TranslationSearch::new(points, epsg, reference)?;
    let no_overlap = |common| CoregisterError::NoOverlap { reference: reference.path.clone(), common };
    search.compare_with([0.0; 2]);
    let mut best = search.best_around([0.0; 2], REACH_M, STEP_M).map_err(no_overlap)?;
    // The search is repeated until no shift around the best one is better than it on the points of both, so that an aligned
    // scene has the shift zero.
    for (reach_m, step_m) in [(REACH_M, STEP_M), (NEAR_M, NEAR_STEP_M)] {
        for _ in 0..ROUNDS {
            search.compare_with(best.at);
            let next = search.best_around(best.at, reach_m, step_m).map_err(no_overlap)?;
            if next.mean_m >= 0.0 {
                break;
            }
            best = next;
        }
    }
    let precision = search.precision(&best);
    let (at, directions) = precision.determined(best.at, FINE_M);
    if directions > 0 && at.iter().any(|v| v.abs() >= REACH_M) {
        return Err(CoregisterError::TooFar { reference: reference.path.clone() });
    }
    let off: Vec<f32> = search.differences(at, REFINED).filter(|d| d.is_finite()).collect();
    if off.len() < FEWEST {
        return Err(no_overlap(off.len()));
    }
    let up_m = interpolated_quantile(&off, 0.5);
    let left: Vec<f32> = off.iter().map(|d| (d - up_m as f32).abs()).collect();
    let [east, north] = precision.sigma();
    Ok(Coregistration {
        shift: Shift { east_m: at[0], north_m: at[1], up_m },
        points: off.len(),
        left_m: interpolated_quantile(&left, 0.5),
        sigma_m: [east, north, search.up_sigma(at, up_m)],
        directions,
        fit: None,
    })
}

/// A horizontal shift with the differences of heights that it leaves.
#[derive(Clone, Copy)]
struct Translation {
    at: [f64; 2],
    /// Mean cost, less that of the shift with which it is compared.
    mean_m: f64,
    common: usize,
}

impl Translation {
    /// Orders by the mean difference; of equal ones the smaller shift comes first.
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        let size = |c: &Self| c.at[0].hypot(c.at[1]);
        a.mean_m.total_cmp(&b.mean_m).then(size(a).total_cmp(&size(b)))
    }
}

/// Costs of some points under a shift: clipped differences from their median; NaN where the reference has no height.
type Costs = Vec<f32>;

/// Points in the pixel coordinates of the reference.
struct TranslationSearch<'a> {
    heights: &'a Grid2,
    /// Column, row and height of each point.
    cells: Vec<([f64; 2], f32)>,
    /// Columns and rows per metre east and per metre north on the points' map.
    by_metre: [[f64; 2]; 2],
    /// Block of ground of each point.
    block: Vec<u8>,
    /// Costs under the shift with which others are compared, of the screened and of the refined points.
    compared: [Costs; 2],
}

impl<'a> TranslationSearch<'a> {
    fn new(points: &[Point<Utm>], epsg: u32, reference: &'a HeightRaster) -> Result<Self, CoregisterError> {
        let grid = reference.grid;
        let transform = (epsg != grid.epsg).then(|| Transform::new(epsg, grid.epsg)).transpose()?;
        let cell_of = |x: f64, y: f64| {
            let (x, y) = transform.map_or((x, y), |t| t.convert(x, y));
            // Centres of cells are at whole numbers.
            [(x - grid.west) / grid.cell - 0.5, (grid.north - y) / grid.cell - 0.5]
        };
        let cells: Vec<_> = points.iter().map(|p| (cell_of(p.x(), p.y()), p.z() as f32)).collect();
        let by_metre = points.first().map_or([[0.0; 2]; 2], |p| {
            let here = cell_of(p.x(), p.y());
            [cell_of(p.x() + 1.0, p.y()), cell_of(p.x(), p.y() + 1.0)]
                .map(|there| [there[0] - here[0], there[1] - here[1]])
        });
        let block = blocks(&cells);
        Ok(Self { heights: &reference.height, cells, by_metre, block, compared: [Vec::new(), Vec::new()] })
    }

    /// Compares shifts with this one from now on.
    fn compare_with(&mut self, at: [f64; 2]) {
        self.compared = [SCREENED, REFINED].map(|at_most| self.costs(at, at_most).1);
    }

    /// Every how-manieth point is among at most so many.
    fn stride(&self, at_most: usize) -> usize {
        self.cells.len().div_ceil(at_most).max(1)
    }

    /// Reference minus point for at most `at_most` of the points; NaN for points that are not on the reference under the shift.
    fn differences(&self, [east, north]: [f64; 2], at_most: usize) -> impl Iterator<Item = f32> + '_ {
        let moved: [f64; 2] =
            std::array::from_fn(|k| east * self.by_metre[0][k] + north * self.by_metre[1][k]);
        let some = self.cells.iter().step_by(self.stride(at_most));
        some.map(move |(px, z)| self.heights.bilinear(px[0] + moved[0], px[1] + moved[1]) - z)
    }

    /// The median difference, and the costs of the points.
    fn costs(&self, at: [f64; 2], at_most: usize) -> (f32, Costs) {
        let mut off: Vec<f32> = self.differences(at, at_most).collect();
        let finite: Vec<f32> = off.iter().copied().filter(|d| d.is_finite()).collect();
        let up_m = interpolated_quantile(&finite, 0.5) as f32;
        // The minimum of NaN and a number would be the number.
        off.iter_mut()
            .for_each(|d| *d = if d.is_finite() { (*d - up_m).abs().min(CLIP_M) } else { f32::NAN });
        (up_m, off)
    }

    fn candidate(&self, at: [f64; 2], at_most: usize) -> Translation {
        let (_, costs) = self.costs(at, at_most);
        let (mut sum, mut common) = (0.0, 0);
        let (mut own, mut compared, mut both) = (0.0, 0.0, 0);
        for (cost, other) in costs.iter().zip(&self.compared[usize::from(at_most == REFINED)]) {
            if cost.is_finite() {
                sum += f64::from(*cost);
                common += 1;
                if other.is_finite() {
                    own += f64::from(*cost);
                    compared += f64::from(*other);
                    both += 1;
                }
            }
        }
        // Points that a shift loses must not make it better: only those that both have count. Without such points, all do.
        let is_comparable = both as f64 >= LEAST_SHARE * common as f64;
        let mean_m = if is_comparable { (own - compared) / both as f64 } else { sum / common as f64 };
        Translation { at, mean_m, common }
    }

    /// The blocks of at most so many points.
    fn some_blocks(&self, at_most: usize) -> Vec<u8> {
        self.block.iter().step_by(self.stride(at_most)).copied().collect()
    }

    /// The precision of the best shift, by its own minimum and by other shifts that fit as well; no shift is one of them.
    fn precision(&self, best: &Translation) -> ShiftPrecision {
        let around = |[east, north]: [f64; 2]| [best.at[0] + STEP_M * east, best.at[1] + STEP_M * north];
        let costs = STENCIL.map(|step| self.costs(around(step), REFINED).1);
        let costs = block_costs(costs.each_ref().map(Vec::as_slice), &self.some_blocks(REFINED));
        let precision = ShiftPrecision::new(&costs, STEP_M);
        // Few points tell which shifts may fit as well, and many whether they do.
        let [few, many] = [SCREENED, REFINED]
            .map(|at_most| (self.costs(best.at, at_most).1, self.some_blocks(at_most), at_most));
        let fits = |(own, blocks, at_most): &(Costs, Vec<u8>, usize), at: [f64; 2]| {
            is_rival(&block_costs([own, &self.costs(at, *at_most).1], blocks))
        };
        let others: Vec<[f64; 2]> = shifts_around([0.0; 2], REACH_M, STEP_M)
            .into_par_iter()
            .map(|at| (at, [at[0] - best.at[0], at[1] - best.at[1]]))
            .filter(|(at, away)| precision.is_apart(*away, STEP_M) && fits(&few, *at) && fits(&many, *at))
            .map(|(_, away)| away)
            .collect();
        others.into_iter().fold(precision, ShiftPrecision::with_rival)
    }

    /// Standard deviation of the height under a shift.
    fn up_sigma(&self, at: [f64; 2], up_m: f64) -> Option<f64> {
        median_sigma(self.some_blocks(REFINED).into_iter().zip(self.differences(at, REFINED)), up_m)
    }

    /// The best shift of a grid around a position, of which half the side and the step are given in metres; else the number
    /// of points on the reference.
    fn best_around(&self, middle: [f64; 2], reach_m: f64, step_m: f64) -> Result<Translation, usize> {
        let (ranked, most) = self.ranked(&shifts_around(middle, reach_m, step_m), SCREENED);
        if most * self.stride(SCREENED) < FEWEST {
            return Err(most);
        }
        let starts: Vec<[f64; 2]> = ranked.iter().take(STARTS).map(|c| c.at).chain([middle]).collect();
        let refined = starts.into_par_iter().filter_map(|s| self.refined(s));
        refined.min_by(Translation::order).ok_or(most)
    }

    /// The shifts ordered by their differences, those that lose many points excepted; and the most points that any has.
    fn ranked(&self, shifts: &[[f64; 2]], at_most: usize) -> (Vec<Translation>, usize) {
        let mut all: Vec<Translation> = shifts.par_iter().map(|s| self.candidate(*s, at_most)).collect();
        let most = all.iter().map(|c| c.common).max().unwrap_or(0);
        all.retain(|c| c.common > 0 && c.common as f64 >= LEAST_SHARE * most as f64);
        all.sort_by(Translation::order);
        (all, most)
    }

    /// Refines a shift by pattern search; none when too few points lie on the reference.
    fn refined(&self, start: [f64; 2]) -> Option<Translation> {
        let start = self.candidate(start, REFINED);
        if start.common < FEWEST {
            return None;
        }
        let least = LEAST_SHARE * start.common as f64;
        let search = PatternSearch { first_step: 0.5 * STEP_M, last_step: FINEST_M, max_moves: usize::MAX };
        let best_of = |best: &Translation, neighbours: Vec<Translation>| {
            let better =
                neighbours.into_iter().filter(|c| c.common as f64 >= least && c.mean_m < best.mean_m);
            better.min_by(Translation::order)
        };
        Some(search.run(start, |c| c.at, |at| self.candidate(at, REFINED), best_of))
    }
}

/// The shifts of a grid around a position.
fn shifts_around(middle: [f64; 2], reach_m: f64, step_m: f64) -> Vec<[f64; 2]> {
    let steps = (reach_m / step_m) as i32;
    let axis = |k: usize| (-steps..=steps).map(move |i| middle[k] + f64::from(i) * step_m);
    axis(1).flat_map(|north| axis(0).map(move |east| [east, north])).collect()
}

/// The block of ground of each point: equal parts of the box of all points.
fn blocks(cells: &[([f64; 2], f32)]) -> Vec<u8> {
    let range = |k: usize| {
        let values = cells.iter().map(|(px, _)| px[k]).filter(|v| v.is_finite());
        values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
    };
    let ranges = [range(0), range(1)];
    let share = |v: f64, (low, high): (f64, f64)| if high > low { (v - low) / (high - low) } else { 0.0 };
    cells.iter().map(|(px, _)| block_of([share(px[0], ranges[0]), share(px[1], ranges[1])])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::MapGrid;

    const EPSG: u32 = 32631;

    /// Heights of a town without a period: blocks on a slope.
    fn height(x: f64, y: f64) -> f64 {
        let (i, j) = ((x / 17.0).floor(), (y / 23.0).floor());
        let block = (i * 7.0 + j * 5.0 + i * j).rem_euclid(9.0);
        100.0 + 2.5 * block + 0.02 * x - 0.01 * y
    }

    fn reference() -> HeightRaster {
        let grid =
            MapGrid { epsg: EPSG, west: 700_000.0, north: 4_800_400.0, cell: 0.5, width: 800, height: 800 };
        let raster =
            Grid2::from_fn(800, 800, |c, r| height(0.5 * c as f64 + 0.25, 399.75 - 0.5 * r as f64) as f32);
        HeightRaster {
            path: "reference.tif".into(),
            grid,
            height: raster,
            vertical: None,
            undeclared_nodata: 0,
            converted_from: None,
        }
    }

    /// Points of the town, shifted by `shift`; a tenth of them have wrong heights.
    fn points(shift: [f64; 3]) -> Vec<Point<Utm>> {
        (0..20_000)
            .map(|i| {
                let (x, y) = (
                    60.0 + 280.0 * (f64::from(i) * 0.618_034).fract(),
                    60.0 + 280.0 * (f64::from(i) * 0.754_878).fract(),
                );
                let wrong = if i % 10 == 0 { 15.0 } else { 0.0 };
                Point::new(
                    700_000.0 + x - shift[0],
                    4_800_000.0 + y - shift[1],
                    height(x, y) + wrong - shift[2],
                )
            })
            .collect()
    }

    #[test]
    fn a_known_shift_is_found_although_some_buildings_changed() {
        for shift in [[0.0, 0.0, 0.0], [3.3, -7.1, 12.4], [-14.2, 9.6, -48.0]] {
            let found = to_surface(&points(shift), EPSG, &reference()).unwrap();
            for ((f, s), sigma) in found.shift.enu().iter().zip(shift).zip(found.sigma_m) {
                assert!((f - s).abs() < 0.1, "{found:?} {shift:?}");
                assert!(sigma.unwrap() < 0.3, "{found:?}");
            }
            assert_eq!(found.directions, 2);
        }
    }

    /// Bare ground that hardly rolls, under points of ground and of blocks on it: the height alone is determined.
    #[test]
    fn a_reference_without_relief_moves_the_height_alone() {
        let mut plain = reference();
        plain.height = Grid2::from_fn(800, 800, |c, r| 0.01 * c as f32 - 0.005 * r as f32);
        let town = |p: Point<Utm>| {
            let (x, y) = (p.x() - 700_000.0, p.y() - 4_800_000.0);
            let block = 2.0 * ((x / 17.0).floor() * 7.0 + (y / 23.0).floor() * 5.0).rem_euclid(9.0) - 8.0;
            let ground = 0.02 * x - 0.01 * (400.0 - y) + 0.1 * (0.7 * x).sin() * (0.9 * y).cos();
            Point::new(p.x(), p.y(), ground + block.max(0.0) - 2.0)
        };
        let points: Vec<_> = points([0.0; 3]).into_iter().map(town).collect();
        let found = to_surface(&points, EPSG, &plain).unwrap();
        assert!(found.directions < 2 && found.open_text().is_some(), "{found:?}");
        assert!((found.shift.up_m - 2.0).abs() < 0.3, "{found:?}");
        let length = found.shift.east_m.hypot(found.shift.north_m);
        assert!(found.directions == 1 || length == 0.0, "{found:?}");
    }

    #[test]
    fn points_and_reference_may_be_in_different_zones() {
        let to = Transform::new(EPSG, EPSG + 1).unwrap();
        let shift = [4.0, -2.0, 1.0];
        let moved: Vec<Point<Utm>> = points([0.0; 3])
            .iter()
            .map(|p| {
                let (x, y) = to.convert(p.x(), p.y());
                Point::new(x - shift[0], y - shift[1], p.z() - shift[2])
            })
            .collect();
        let found = to_surface(&moved, EPSG + 1, &reference()).unwrap();
        for (f, s) in found.shift.enu().iter().zip(shift) {
            assert!((f - s).abs() < 0.1, "{found:?}");
        }
    }

    #[test]
    fn a_reference_that_is_elsewhere_empty_or_flat_is_refused() {
        let mut away = reference();
        away.grid.west += 5000.0;
        assert!(matches!(
            to_surface(&points([0.0; 3]), EPSG, &away),
            Err(CoregisterError::NoOverlap { common: 0, .. })
        ));
        let mut empty = reference();
        empty.height.data.fill(f32::NAN);
        assert!(matches!(
            to_surface(&points([0.0; 3]), EPSG, &empty),
            Err(CoregisterError::NoOverlap { .. })
        ));
        let far = to_surface(&points([60.0, 0.0, 0.0]), EPSG, &reference());
        assert!(!far.is_ok_and(|a| a.left_m < 0.1));
        assert!(matches!(to_surface(&[], EPSG, &reference()), Err(CoregisterError::NoOverlap { .. })));
    }
}
