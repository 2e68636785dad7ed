//! The shift by whole cells with the highest normalised cross-correlation, found from coarse to fine.
//!
//! The method is that of `dsmr.py` in EOGS: both grids are halved while their shorter side exceeds 100 cells; at each level,
//! all shifts within 5 cells of twice the shift of the coarser level are compared.

use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;

/// Grids are halved while their shorter side exceeds this number of cells.
const SMALL_SIDE: usize = 100;
/// Search radius at each level, in cells of that level.
const REACH: i64 = 5;
/// Smallest overlap of a shift, as a fraction of the largest overlap of all shifts.
const LEAST_OVERLAP: f64 = 0.25;

/// (dx, dy) for which `prediction[row + dy, col + dx]` correlates best with `truth[row, col]`.
pub(super) fn best_whole_shift(prediction: &Grid2, truth: &Grid2) -> (i64, i64) {
    let mut center = (0, 0);
    if truth.width.min(truth.height) > SMALL_SIDE {
        let (dx, dy) = best_whole_shift(&prediction.halved(), &truth.halved());
        center = (2 * dx, 2 * dy);
    }
    let shifts: Vec<(i64, i64)> = (-REACH..=REACH)
        .flat_map(|dy| (-REACH..=REACH).map(move |dx| (center.0 + dx, center.1 + dy)))
        .collect();
    let moments: Vec<Moments> = shifts.par_iter().map(|s| Moments::of(prediction, truth, *s)).collect();
    let enough = moments.iter().map(|m| m.n).fold(0.0, f64::max) * LEAST_OVERLAP;
    // Of shifts with equal correlation the smallest one is taken, so that a flat scene is not shifted.
    let rank = |i: usize| {
        let (dx, dy) = shifts[i];
        let ncc = if moments[i].n >= enough { moments[i].correlation() } else { f64::NEG_INFINITY };
        (ncc, -(dx * dx + dy * dy))
    };
    (0..shifts.len())
        .max_by(|&a, &b| rank(a).partial_cmp(&rank(b)).unwrap_or(std::cmp::Ordering::Equal))
        .map_or(center, |i| shifts[i])
}

/// Sums over the cells that are valid in both grids.
#[derive(Clone, Copy, Default)]
struct Moments {
    n: f64,
    a: f64,
    b: f64,
    aa: f64,
    bb: f64,
    ab: f64,
}

/// Largest number of cells for one correlation; rows are left out of larger grids.
const ENOUGH_CELLS: usize = 1 << 22;
/// Number of partial sums, so that the compiler uses SIMD instructions.
const LANES: usize = 8;

impl Moments {
    fn of(prediction: &Grid2, truth: &Grid2, (dx, dy): (i64, i64)) -> Self {
        let mut m = Self::default();
        let (w, h) = (truth.width as i64, truth.height as i64);
        let cols = (-dx).clamp(0, w) as usize..(w - dx).clamp(0, w) as usize;
        let step = (truth.data.len() / ENOUGH_CELLS).max(1);
        for row in ((-dy).clamp(0, h)..(h - dy).clamp(0, h)).step_by(step) {
            if cols.is_empty() {
                break;
            }
            let t = &truth.row(row as usize)[cols.clone()];
            let first = (cols.start as i64 + dx) as usize;
            m.add(&prediction.row((row + dy) as usize)[first..first + t.len()], t);
        }
        m
    }

    /// Adds the cells of a row that are valid in both grids.
    fn add(&mut self, a: &[f32], b: &[f32]) {
        let sums = row_sums(a, b).map(|lanes| lanes.iter().sum::<f64>());
        let own = [&mut self.n, &mut self.a, &mut self.b, &mut self.aa, &mut self.bb, &mut self.ab];
        own.into_iter().zip(sums).for_each(|(own, sum)| *own += sum);
    }

    /// The correlation coefficient; minus infinity if a raster is constant.
    fn correlation(&self) -> f64 {
        let covariance = self.ab - self.a * self.b / self.n;
        let spread = (self.aa - self.a * self.a / self.n) * (self.bb - self.b * self.b / self.n);
        let ncc = covariance / spread.sqrt();
        if spread > 0.0 && ncc.is_finite() { ncc } else { f64::NEG_INFINITY }
    }
}

/// Number of valid cells of a row, and the sums of a, b, a², b² and ab, each as partial sums.
#[multiversion(targets("x86_64+avx2+fma"))]
fn row_sums(a: &[f32], b: &[f32]) -> [[f64; LANES]; 6] {
    let mut sums = [[0.0; LANES]; 6];
    let (a, a_rest) = a.as_chunks::<LANES>();
    let (b, b_rest) = b.as_chunks::<LANES>();
    // The remainder is padded with cells that are not valid.
    let filled_up = |rest: &[f32]| std::array::from_fn(|i| rest.get(i).copied().unwrap_or(f32::NAN));
    let last = [(filled_up(a_rest), filled_up(b_rest))];
    for (a, b) in a.iter().copied().zip(b.iter().copied()).chain(last) {
        for i in 0..LANES {
            let both = !(a[i] * b[i]).is_nan();
            let (a, b) = if both { (f64::from(a[i]), f64::from(b[i])) } else { (0.0, 0.0) };
            let terms = [f64::from(u8::from(both)), a, b, a * a, b * b, a * b];
            for (sum, term) in sums.iter_mut().zip(terms) {
                sum[i] += term;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_scene_is_not_shifted() {
        let flat = Grid2::filled(120, 120, 5.0);
        assert_eq!(best_whole_shift(&flat, &flat), (0, 0));
    }

    #[test]
    fn shifts_larger_than_the_search_radius_are_found() {
        let truth = Grid2::from_fn(260, 240, |c, r| {
            let (x, y) = (c as f32, r as f32);
            (0.05 * x + 0.0004 * x * y).sin() * 8.0 + (0.08 * y).cos() * 5.0
        });
        let prediction = Grid2::from_fn(260, 240, |c, r| truth.get(c as i64 + 17, r as i64 - 9));
        assert_eq!(best_whole_shift(&prediction, &truth), (-17, 9));
    }
}
