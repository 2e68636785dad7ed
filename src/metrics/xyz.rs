//! The shift and median height offset of the smallest mean absolute error, found globally.
//!
//! Every bilinear shift on a grid of ±4 cells by 0.25 is looked at on a sample of the cells, the best of them on
//! all (up to a bound), and from the best of these a pattern search goes down to 1/256 of a cell.

use super::scores::quantile_in_place;
use crate::raster::Plane;
use rayon::prelude::*;

/// Reach of the grid in cells.
const REACH: f64 = 4.0;
/// Step of the grid in cells.
const STEP: f64 = 0.25;
/// Step at which the refinement stops, in cells.
const FINEST: f64 = 1.0 / 256.0;
/// Cells looked at for every shift of the grid.
const SCREENED_CELLS: usize = 1 << 16;
/// Cells looked at for the best of them and for the refinement.
const REFINED_CELLS: usize = 1 << 20;
/// Shifts of the grid that are looked at again with more cells.
const SHORTLIST: usize = 32;
/// Starts of the refinement: the error has a small minimum in every cell.
const STARTS: usize = 4;
/// A shift that leaves fewer cells than this share of the most any shift leaves is not compared.
const LEAST_CELLS: f64 = 0.5;
/// Border of NaN around the prediction, wider than any shift.
const BORDER: usize = REACH as usize + 3;

/// (dx, dy) in cells and dz in metres that minimise the MAE after clipping to `bounds`.
pub(super) fn best_shift(prediction: &Plane, truth: &Plane, bounds: (f32, f32)) -> (f64, f64, f64) {
    let padded = padded(prediction);
    let screen = Search::new(&padded, truth, bounds, SCREENED_CELLS);
    let steps = (REACH / STEP) as i32;
    let axis = || (-steps..=steps).map(|i| f64::from(i) * STEP);
    let grid: Vec<(f64, f64)> = axis().flat_map(|dy| axis().map(move |dx| (dx, dy))).collect();
    let shortlist: Vec<(f64, f64)> =
        screen.ranked(&grid).into_iter().take(SHORTLIST).map(|c| c.shift).collect();
    let search = Search::new(&padded, truth, bounds, REFINED_CELLS);
    let mut starts = search.ranked(&shortlist);
    starts.truncate(STARTS);
    let least = starts.iter().map(|c| c.cells).max().unwrap_or(0) as f64 * LEAST_CELLS;
    let refined: Vec<Candidate> = starts.par_iter().map(|c| search.refined(*c, least)).collect();
    let best = refined.into_iter().min_by(Candidate::order);
    best.map_or((0.0, 0.0, f64::NAN), |c| (c.shift.0, c.shift.1, c.dz_m))
}

/// A shift and what it leaves.
#[derive(Clone, Copy)]
struct Candidate {
    shift: (f64, f64),
    dz_m: f64,
    mae_m: f64,
    cells: usize,
}

impl Candidate {
    /// By error; of equal ones the smaller shift comes first.
    fn order(a: &Self, b: &Self) -> std::cmp::Ordering {
        let size = |c: &Self| c.shift.0.hypot(c.shift.1);
        a.mae_m.total_cmp(&b.mae_m).then(size(a).total_cmp(&size(b)))
    }
}

/// The prediction with a border of NaN, and the cells of the truth that are looked at.
struct Search<'a> {
    padded: &'a Plane,
    /// Index into `padded` at no shift, and the truth's height.
    cells: Vec<(usize, f32)>,
    bounds: (f32, f32),
}

/// The plane within a border of NaN.
fn padded(plane: &Plane) -> Plane {
    let (width, height) = (plane.width + 2 * BORDER, plane.height + 2 * BORDER);
    Plane::from_rows(width, height, |row, line| {
        line.fill(f32::NAN);
        if let Some(row) = row.checked_sub(BORDER).filter(|row| *row < plane.height) {
            line[BORDER..BORDER + plane.width].copy_from_slice(plane.row(row));
        }
    })
}

impl<'a> Search<'a> {
    fn new(padded: &'a Plane, truth: &Plane, bounds: (f32, f32), at_most: usize) -> Self {
        let (w, h) = (truth.width, truth.height);
        let mut stride = 1;
        while w.div_ceil(stride) * h.div_ceil(stride) > at_most {
            stride += 1;
        }
        let cells = (0..h)
            .step_by(stride)
            .flat_map(|row| (0..w).step_by(stride).map(move |col| (col, row)))
            .map(|(col, row)| ((row + BORDER) * padded.width + col + BORDER, truth.at(col, row)))
            .filter(|(_, t)| !t.is_nan())
            .collect();
        Self { padded, cells, bounds }
    }

    /// Candidates of `shifts`, the best first; those that leave too few cells are dropped.
    fn ranked(&self, shifts: &[(f64, f64)]) -> Vec<Candidate> {
        let mut all: Vec<Candidate> = shifts.par_iter().map(|s| self.candidate(*s)).collect();
        let least = all.iter().map(|c| c.cells).max().unwrap_or(0) as f64 * LEAST_CELLS;
        all.retain(|c| c.cells > 0 && c.cells as f64 >= least);
        all.sort_by(Candidate::order);
        all
    }

    /// Pattern search: to the best of eight neighbours while one is better, then with half the step.
    fn refined(&self, mut best: Candidate, least_cells: f64) -> Candidate {
        let mut step = STEP / 2.0;
        while step >= FINEST {
            let neighbours: Vec<Candidate> = (-1..=1)
                .flat_map(|j| (-1..=1).map(move |i| (f64::from(i), f64::from(j))))
                .filter(|d| *d != (0.0, 0.0))
                .map(|(i, j)| (best.shift.0 + i * step, best.shift.1 + j * step))
                .filter(|(dx, dy)| dx.abs() <= REACH + STEP && dy.abs() <= REACH + STEP)
                .collect::<Vec<_>>()
                .par_iter()
                .map(|s| self.candidate(*s))
                .collect();
            let next = neighbours
                .into_iter()
                .filter(|c| c.cells as f64 >= least_cells && c.mae_m < best.mae_m)
                .min_by(Candidate::order);
            match next {
                Some(better) => best = better,
                None => step /= 2.0,
            }
        }
        best
    }

    fn candidate(&self, (dx, dy): (f64, f64)) -> Candidate {
        let (fx, fy) = ((dx - dx.floor()) as f32, (dy - dy.floor()) as f32);
        let offset = dy.floor() as isize * self.padded.width as isize + dx.floor() as isize;
        // A weight of zero must not let a NaN in.
        let right = usize::from(fx > 0.0);
        let down = if fy > 0.0 { self.padded.width } else { 0 };
        let mut pairs = Vec::with_capacity(self.cells.len());
        for &(index, t) in &self.cells {
            let p = &self.padded.data[index.wrapping_add_signed(offset)..];
            let upper = p[0] + (p[right] - p[0]) * fx;
            let lower = p[down] + (p[down + right] - p[down]) * fx;
            let v = upper + (lower - upper) * fy;
            if !v.is_nan() {
                pairs.push((v, t));
            }
        }
        let mut differences: Vec<f32> = pairs.iter().map(|(v, t)| v - t).collect();
        let dz_m = -quantile_in_place(&mut differences, 0.5);
        let (low, high) = self.bounds;
        let dz = dz_m as f32;
        let sum: f64 = pairs.iter().map(|(v, t)| f64::from(((v + dz).clamp(low, high) - t).abs())).sum();
        Candidate { shift: (dx, dy), dz_m, mae_m: sum / pairs.len() as f64, cells: pairs.len() }
    }
}
