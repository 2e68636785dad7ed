//! Registration by the horizontal shift and the median height offset with the smallest mean absolute error.
//!
//! The search starts at three shifts: none, the best whole-cell correlation and the peak of the phase correlation.
//! Around each start a grid of shifts is evaluated on a sample of the cells; the grid is moved while its best shift
//! lies at its edge. The best shifts are refined by pattern search to 1/256 of a cell.
//!
//! Directions in which the errors do not determine the shift are not moved; no shift is always a candidate.
//!
//! Interpolation between cells averages noise, so that shifts by half a cell would have smaller errors for no other
//! reason. Therefore heights are interpolated by three taps along each axis whose squares sum to 1/2 for every shift,
//! also those of the truth; cells with holes are excluded without excluding their neighbours; and two shifts are
//! compared on the cells that both cover.

use super::ncc::best_whole_shift;
use super::pattern_search::PatternSearch;
use super::phase::peak;
use super::resample::interpolate;
use super::shift_precision::{STENCIL, ShiftPrecision, block_costs, block_of, is_rival, median_sigma};
use crate::io::Grid2;
use crate::stats::interpolated_quantile_in_place;
use rayon::prelude::*;

/// Half the side of the grid of shifts and its step, cells.
const REACH: f64 = 4.0;
const STEP: f64 = 0.5;
/// Largest number of times that the grid is moved.
const MOVES: usize = 24;
/// Last step of the refinement, cells.
const FINEST: f64 = 1.0 / 256.0;
/// Largest number of moves of the refinement with one step.
const MOST_MOVES: usize = 64;
/// Number of cells that are evaluated for every shift of the grid.
const SCREENED_CELLS: usize = 1 << 16;
/// Number of cells that are evaluated for the best shifts of the grid and during the refinement.
const REFINED_CELLS: usize = 1 << 20;
/// Number of shifts of each grid that are refined: the error has a local minimum in every cell.
const STARTS: usize = 4;
/// A shift is compared only if it covers at least this fraction of the most cells that any shift covers.
const LEAST_CELLS: f64 = 0.25;
/// A direction whose standard deviation is below this is determined, cells; others only by shifts that are several times theirs.
const FINE: f64 = 1.0;
/// Other shifts that may fit as well are looked for up to this distance from the best one, and in these steps, cells.
const RIVALS_REACH: i32 = 8;
const RIVALS_STEP: usize = 2;

/// A shift that was found: cells, and the height offset in metres; what determines it.
pub(super) struct FoundShift {
    pub shift: (f64, f64),
    pub dz_m: f64,
    pub dz_sigma_m: Option<f64>,
    /// Standard deviations of the shift, cells; none where nothing determines it.
    pub sigma: [Option<f64>; 2],
    /// Whether all of the best shift was determined, and is in `shift`.
    pub is_determined: bool,
}

/// The shift (dx, dy) in cells and the offset dz in metres with the smallest MAE after clipping to `bounds`.
pub(super) fn best_shift(
    prediction: &Grid2,
    truth: &Grid2,
    bounds: (f32, f32),
) -> (FoundShift, ShiftPrecision) {
    let (filled, truth_filled) = (Filled::new(prediction), Filled::new(truth));
    let ncc = best_whole_shift(prediction, truth);
    let mut starts = vec![(0.0, 0.0), (ncc.0 as f64, ncc.1 as f64)];
    starts.extend(peak(prediction, truth));
    let screen = ShiftSearch::new(&filled, &truth_filled, bounds, SCREENED_CELLS);
    let mut found: Vec<(f64, f64)> =
        starts.iter().flat_map(|s| screen.around(*s)).chain([(0.0, 0.0)]).collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    found.dedup();
    let search = ShiftSearch::new(&filled, &truth_filled, bounds, REFINED_CELLS);
    let mut candidates: Vec<ShiftCandidate> = found.par_iter().map(|s| search.candidate(*s)).collect();
    drop_small(&mut candidates);
    let best = candidates
        .into_iter()
        .map(|c| search.refined(c))
        .reduce(|a, b| if b.is_better_than(&a) { b } else { a });
    let best = best.map_or((0.0, 0.0), |best| best.shift);
    let precision = search.precision(best).with_rivals(&screen, best, found);
    (located(prediction, truth, best, &precision), precision)
}

/// The whole-cell shift with the highest correlation, in the directions that the errors around the best shift determine; dz =
/// -mean(P - T) is the caller's.
pub(super) fn best_correlation(prediction: &Grid2, truth: &Grid2, precision: &ShiftPrecision) -> FoundShift {
    let (dx, dy) = best_whole_shift(prediction, truth);
    let found = located(prediction, truth, (dx as f64, dy as f64), precision);
    FoundShift { shift: (found.shift.0.round(), found.shift.1.round()), ..found }
}

/// The part of a shift that is determined, with the offset there.
fn located(prediction: &Grid2, truth: &Grid2, best: (f64, f64), precision: &ShiftPrecision) -> FoundShift {
    let ([dx, dy], directions) = precision.determined([best.0, best.1], FINE);
    let (dz_m, dz_sigma_m) = offset(prediction, truth, (dx, dy));
    let (sigma, is_determined) = (precision.sigma(), directions == 2);
    FoundShift { shift: (dx, dy), dz_m, dz_sigma_m, sigma, is_determined }
}

/// Height offset of a shift, -median(P - T), and its standard deviation.
pub(super) fn offset(prediction: &Grid2, truth: &Grid2, (dx, dy): (f64, f64)) -> (f64, Option<f64>) {
    let row_differences = |row: usize| {
        let line = truth.row(row).iter().enumerate().filter(|(_, t)| !t.is_nan());
        line.map(|(col, t)| (col, interpolate(prediction, col as f64 + dx, row as f64 + dy) - t))
            .filter(|(_, d)| !d.is_nan())
            .map(|(col, d)| (block_of_cell(truth, col, row), d))
            .collect::<Vec<_>>()
    };
    let all: Vec<(u8, f32)> = (0..truth.height).into_par_iter().flat_map_iter(row_differences).collect();
    let mut differences: Vec<f32> = all.iter().map(|(_, d)| *d).collect();
    let median = interpolated_quantile_in_place(&mut differences, 0.5);
    (-median, median_sigma(all.into_iter(), median))
}

/// The block of ground of a cell.
fn block_of_cell(grid: &Grid2, col: usize, row: usize) -> u8 {
    block_of([col as f64 / grid.width as f64, row as f64 / grid.height as f64])
}

/// Drops candidates that cover too few cells.
fn drop_small(all: &mut Vec<ShiftCandidate>) {
    let least = all.iter().map(|c| c.cells).max().unwrap_or(0) as f64 * LEAST_CELLS;
    all.retain(|c| c.cells > 0 && c.cells as f64 >= least);
}

/// A shift with its errors.
#[derive(Clone)]
struct ShiftCandidate {
    shift: (f64, f64),
    mae_m: f64,
    cells: usize,
    /// Absolute error of every evaluated cell; NaN where the shifted prediction has no height.
    errors: Vec<f32>,
}

impl ShiftCandidate {
    /// Mean difference between the errors of two candidates on the cells that both cover, and the number of these
    /// cells.
    fn against(&self, other: &Self) -> (f64, usize) {
        let both = self.errors.iter().zip(&other.errors).map(|(a, b)| f64::from(a - b));
        let (sum, n) = both.filter(|d| !d.is_nan()).fold((0.0, 0usize), |(sum, n), d| (sum + d, n + 1));
        (sum / n as f64, n)
    }

    /// Compares by the errors on common cells if these are enough; of equal candidates the smaller shift is better.
    fn is_better_than(&self, other: &Self) -> bool {
        let (mean, common) = self.against(other);
        let difference = if (common as f64) < LEAST_CELLS * self.cells.max(other.cells) as f64 {
            self.mae_m - other.mae_m
        } else {
            mean
        };
        let size = |c: &Self| c.shift.0.hypot(c.shift.1);
        difference < 0.0 || (difference == 0.0 && size(self) < size(other))
    }

    /// Orders by MAE; of equal candidates the smaller shift comes first.
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        let size = |c: &Self| c.shift.0.hypot(c.shift.1);
        a.mae_m.total_cmp(&b.mae_m).then(size(a).total_cmp(&size(b)))
    }
}

/// A height raster whose holes are filled one cell deep, with a border of one cell, so that the taps of a valid cell
/// find values.
struct Filled {
    raster: Grid2,
    is_valid: Vec<bool>,
}

impl Filled {
    fn new(source: &Grid2) -> Self {
        let (width, height) = (source.width + 2, source.height + 2);
        let at = |col: usize, row: usize| source.get(col as i64 - 1, row as i64 - 1);
        let raster = Grid2::from_rows(width, height, |row, line| {
            for (col, v) in line.iter_mut().enumerate() {
                *v = at(col, row);
                if v.is_nan() {
                    let around = (0..9).map(|i| source.get(col as i64 + i % 3 - 2, row as i64 + i / 3 - 2));
                    let (sum, n) =
                        around.filter(|v| !v.is_nan()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
                    *v = sum / n;
                }
            }
        });
        let is_valid = (0..width * height).map(|i| !at(i % width, i / width).is_nan()).collect();
        Self { raster, is_valid }
    }

    /// Height at a cell plus a fraction of a cell, by the taps of that fraction; NaN where the cell is a hole.
    fn at(&self, col: i64, row: i64, across: [f32; 3], down: [f32; 3]) -> f32 {
        let (width, height) = (self.raster.width as i64, self.raster.height as i64);
        if col < 0 || row < 0 || col + 2 >= width || row + 2 >= height {
            return f32::NAN;
        }
        let i = row as usize * self.raster.width + col as usize;
        if !self.is_valid[i + self.raster.width + 1] {
            return f32::NAN;
        }
        let line = |k: usize| {
            let p = &self.raster.data[i + k * self.raster.width..][..3];
            across[0] * p[0] + across[1] * p[1] + across[2] * p[2]
        };
        down[0] * line(0) + down[1] * line(1) + down[2] * line(2)
    }
}

/// Weights of a cell and its two neighbours for a position `part` of a cell (-0.5 to 0.5) from its centre. The weights
/// sum to 1, their centre of mass is the position, and their squares sum to 1/2.
fn taps(part: f64) -> [f32; 3] {
    let sides = (2.0 - (1.0 - 3.0 * part * part).max(0.0).sqrt()) / 3.0;
    [(sides - part) / 2.0, 1.0 - sides, (sides + part) / 2.0].map(|w| w as f32)
}

/// The prediction, and the cells of the truth on which shifts are evaluated.
struct ShiftSearch<'a> {
    prediction: &'a Filled,
    /// Column, row and height of the truth, smoothed by the taps of no shift.
    cells: Vec<(i64, i64, f32)>,
    /// Block of ground of each of them.
    block: Vec<u8>,
    bounds: (f32, f32),
}

impl<'a> ShiftSearch<'a> {
    fn new(prediction: &'a Filled, truth: &Filled, bounds: (f32, f32), at_most: usize) -> Self {
        let (w, h) = (truth.raster.width - 2, truth.raster.height - 2);
        let mut stride = 1;
        while w.div_ceil(stride) * h.div_ceil(stride) > at_most {
            stride += 1;
        }
        let middle = taps(0.0);
        let cells: Vec<(i64, i64, f32)> = (0..h as i64)
            .step_by(stride)
            .flat_map(|row| (0..w as i64).step_by(stride).map(move |col| (col, row)))
            .map(|(col, row)| (col, row, truth.at(col, row, middle, middle)))
            .filter(|(_, _, t)| !t.is_nan())
            .collect();
        let block =
            |(col, row, _): &(i64, i64, f32)| block_of([*col as f64 / w as f64, *row as f64 / h as f64]);
        let block = cells.iter().map(block).collect();
        Self { prediction, cells, block, bounds }
    }

    /// The precision of a shift by the curvature of the errors around it.
    fn precision(&self, (dx, dy): (f64, f64)) -> ShiftPrecision {
        let around = STENCIL.map(|[x, y]| self.candidate((dx + x, dy + y)).errors);
        ShiftPrecision::new(&block_costs(around.each_ref().map(Vec::as_slice), &self.block), 1.0)
    }

    /// The best shifts of a grid around a start; the grid is moved while its best shift lies at its edge.
    fn around(&self, start: (f64, f64)) -> Vec<(f64, f64)> {
        let steps = (REACH / STEP) as i32;
        let axis = || (-steps..=steps).map(|i| f64::from(i) * STEP);
        let mut center = start;
        for _ in 0..MOVES {
            let grid: Vec<(f64, f64)> =
                axis().flat_map(|dy| axis().map(move |dx| (center.0 + dx, center.1 + dy))).collect();
            let mut all: Vec<ShiftCandidate> = grid
                .into_par_iter()
                .map(|s| ShiftCandidate { errors: Vec::new(), ..self.candidate(s) })
                .collect();
            drop_small(&mut all);
            all.sort_by(ShiftCandidate::order);
            let Some(best) = all.first().map(|c| c.shift) else { return Vec::new() };
            if (best.0 - center.0).abs().max((best.1 - center.1).abs()) < REACH {
                return all.into_iter().take(STARTS).map(|c| c.shift).collect();
            }
            center = best;
        }
        // An edge is no answer.
        Vec::new()
    }

    /// Refines a shift by pattern search.
    fn refined(&self, start: ShiftCandidate) -> ShiftCandidate {
        // The limit is needed because the comparison on common cells is not transitive.
        let search = PatternSearch { first_step: STEP / 2.0, last_step: FINEST, max_moves: MOST_MOVES };
        let best_of = |best: &ShiftCandidate, neighbours: Vec<ShiftCandidate>| {
            let least = best.cells as f64 * LEAST_CELLS;
            let better =
                neighbours.into_iter().filter(|c| c.cells as f64 >= least && c.against(best).0 < 0.0);
            better.reduce(|a, b| if b.is_better_than(&a) { b } else { a })
        };
        search.run(start, |c| [c.shift.0, c.shift.1], |[dx, dy]| self.candidate((dx, dy)), best_of)
    }

    fn candidate(&self, (dx, dy): (f64, f64)) -> ShiftCandidate {
        let (across, down) = (taps(dx - dx.round()), taps(dy - dy.round()));
        let (cols, rows) = (dx.round() as i64, dy.round() as i64);
        let of_cell =
            |(col, row, t): &(i64, i64, f32)| self.prediction.at(col + cols, row + rows, across, down) - t;
        let mut errors: Vec<f32> = self.cells.iter().map(of_cell).collect();
        let mut differences: Vec<f32> = errors.iter().copied().filter(|d| !d.is_nan()).collect();
        let cells = differences.len();
        let dz = -interpolated_quantile_in_place(&mut differences, 0.5) as f32;
        let (low, high) = self.bounds;
        let mut sum = 0.0;
        for (d, (_, _, t)) in errors.iter_mut().zip(&self.cells) {
            *d = ((*d + t + dz).clamp(low, high) - t).abs();
            if !d.is_nan() {
                sum += f64::from(*d);
            }
        }
        ShiftCandidate { shift: (dx, dy), mae_m: sum / cells as f64, cells, errors }
    }
}

impl ShiftPrecision {
    /// With the other shifts that fit as well as the best one: of some that were found, and of a grid around it.
    fn with_rivals(self, search: &ShiftSearch, best: (f64, f64), found: Vec<(f64, f64)>) -> Self {
        let own = search.candidate(best).errors;
        let axis = || (-RIVALS_REACH..=RIVALS_REACH).step_by(RIVALS_STEP).map(f64::from);
        let grid = axis().flat_map(|dy| axis().map(move |dx| (best.0 + dx, best.1 + dy)));
        let apart = |(dx, dy): &(f64, f64)| self.is_apart([dx - best.0, dy - best.1], 1.0);
        let others: Vec<(f64, f64)> = found.into_iter().chain(grid).filter(apart).collect();
        let rivals: Vec<[f64; 2]> = others
            .into_par_iter()
            .filter(|shift| {
                let pairs = block_costs([&own, &search.candidate(*shift).errors], &search.block);
                !pairs.is_empty() && is_rival(&pairs)
            })
            .map(|(dx, dy)| [dx - best.0, dy - best.1])
            .collect();
        rivals.into_iter().fold(self, Self::with_rival)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn taps_average_noise_alike_and_keep_the_place() {
        for part in [-0.5, -0.3, 0.0, 0.1, 0.25, 0.5] {
            let w = taps(part).map(f64::from);
            assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-6);
            assert!((w[2] - w[0] - part).abs() < 1e-6);
            assert!((w.iter().map(|w| w * w).sum::<f64>() - 0.5).abs() < 1e-6);
        }
    }
}
