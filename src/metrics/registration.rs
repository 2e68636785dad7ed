//! Registrations: the translation that is applied to a prediction before it is scored.
//!
//! `z` is MAE_reg of the BAEOGS paper (equation 4), `ncc` is the registration of EOGS's `dsmr.py`, `xyz` has the
//! smallest MAE. `ncc` and `xyz` do not move a surface in directions in which nothing determines the shift.

use super::xyz::{FoundShift, best_correlation, best_shift, offset};
use crate::io::Grid2;
use rayon::prelude::*;
use serde::Serialize;

/// A registration method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// No shift; dz = -median(P - T).
    Z,
    /// The whole-cell shift of the highest normalised cross-correlation; dz = -mean(P - T).
    Ncc,
    /// The horizontal shift and median height offset with the smallest MAE.
    Xyz,
}

impl Method {
    /// All methods, in the order of tables.
    pub const ALL: [Self; 3] = [Self::Z, Self::Ncc, Self::Xyz];

    /// Name in tables and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Z => "z",
            Self::Ncc => "ncc",
            Self::Xyz => "xyz",
        }
    }
}

/// `registered[row, col] = P[row + dy, col + dx] + dz`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Registration {
    /// The method.
    pub method: Method,
    /// Columns added to a cell's position before the prediction is sampled.
    pub dx_cells: f64,
    /// Rows added to a cell's position before the prediction is sampled.
    pub dy_cells: f64,
    /// Metres added to the prediction.
    pub dz_m: f64,
    /// Standard deviation of `dx_cells`; none where the heights do not determine it, and for methods without a shift.
    pub dx_sigma_cells: Option<f64>,
    /// The same of `dy_cells`.
    pub dy_sigma_cells: Option<f64>,
    /// Standard deviation of `dz_m`.
    pub dz_sigma_m: Option<f64>,
    /// Whether the heights determine the shift; its part in other directions is 0.
    pub is_determined: bool,
}

impl Registration {
    /// Cells the prediction is moved east and north on the grid of the truth.
    #[must_use]
    pub fn moved_cells(&self) -> [f64; 2] {
        // Adding zero turns -0 into 0.
        [-self.dx_cells + 0.0, self.dy_cells + 0.0]
    }
}

/// The registrations of `prediction` to `land` (NaN where not scored), both on one grid, in the order of [`Method::ALL`].
///
/// `bounds` are the heights, in metres, to which registered values are clipped before errors are taken.
#[must_use]
pub fn registrations(prediction: &Grid2, land: &Grid2, bounds: (f32, f32)) -> [Registration; 3] {
    let (dz_m, dz_sigma_m) = offset(prediction, land, (0.0, 0.0));
    let z = FoundShift { shift: (0.0, 0.0), dz_m, dz_sigma_m, sigma: [None; 2], is_determined: true };
    let (xyz, precision) = best_shift(prediction, land, bounds);
    let ncc = best_correlation(prediction, land, &precision);
    let whole = (ncc.shift.0 as i64, ncc.shift.1 as i64);
    let ncc = FoundShift { dz_m: -mean_difference(prediction, land, whole), ..ncc };
    [(Method::Z, z), (Method::Ncc, ncc), (Method::Xyz, xyz)]
        .map(|(method, found)| registration(method, &found))
}

fn registration(method: Method, found: &FoundShift) -> Registration {
    // Adding zero turns -0 into 0.
    Registration {
        method,
        dx_cells: found.shift.0 + 0.0,
        dy_cells: found.shift.1 + 0.0,
        dz_m: found.dz_m + 0.0,
        dx_sigma_cells: found.sigma[0],
        dy_sigma_cells: found.sigma[1],
        dz_sigma_m: found.dz_sigma_m,
        is_determined: found.is_determined,
    }
}

/// Mean of `prediction[row + dy, col + dx] - land[row, col]` over the cells where both are valid.
fn mean_difference(prediction: &Grid2, land: &Grid2, (dx, dy): (i64, i64)) -> f64 {
    let of_row = |row: usize| {
        let (mut sum, mut cells) = (0.0, 0usize);
        for (col, t) in land.row(row).iter().enumerate() {
            let d = prediction.get(col as i64 + dx, row as i64 + dy) - t;
            if !d.is_nan() {
                sum += f64::from(d);
                cells += 1;
            }
        }
        (sum, cells)
    };
    // The sums of rows are added in the order of the rows, so that the result does not depend on the threads.
    let rows: Vec<_> = (0..land.height).into_par_iter().map(of_row).collect();
    let (sum, cells) = rows.iter().fold((0.0, 0), |(s, n), row| (s + row.0, n + row.1));
    sum / cells as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Heights of a town without periodic structures: blocks of different heights on a slope.
    fn town(size: usize) -> Grid2 {
        Grid2::from_fn(size, size, |c, r| {
            let (x, y) = (c as f32, r as f32);
            let block = ((c / 13 * 7 + r / 11 * 5 + (c / 13) * (r / 11)) % 9) as f32;
            block * 2.5 + 0.02 * x - 0.01 * y + (0.3 * x).sin() * (0.23 * y).cos()
        })
    }

    const ALL_HEIGHTS: (f32, f32) = (f32::MIN, f32::MAX);

    fn register(method: Method, prediction: &Grid2, land: &Grid2, bounds: (f32, f32)) -> Registration {
        registrations(prediction, land, bounds).into_iter().find(|r| r.method == method).unwrap()
    }

    #[test]
    fn a_known_shift_is_found_exactly() {
        let truth = town(150);
        // In the prediction, the town lies 2 cells further east, 3 cells further south and 3.7 m higher.
        let prediction = Grid2::from_fn(150, 150, |c, r| truth.get(c as i64 - 2, r as i64 - 3) + 3.7);
        for method in [Method::Ncc, Method::Xyz] {
            let found = register(method, &prediction, &truth, ALL_HEIGHTS);
            assert_eq!((found.dx_cells, found.dy_cells), (2.0, 3.0), "{method:?}");
            assert!((found.dz_m + 3.7).abs() < 1e-4, "{found:?}");
            assert_eq!(found.moved_cells(), [-2.0, 3.0]);
            assert!(found.is_determined && found.dx_sigma_cells.unwrap() < 0.5, "{found:?}");
        }
        assert!((mean_difference(&prediction, &truth, (2, 3)) - 3.7).abs() < 1e-4);
    }

    #[test]
    fn a_shift_of_a_fraction_of_a_cell_is_refined() {
        let truth = Grid2::from_fn(150, 150, |c, r| {
            let (x, y) = (c as f32, r as f32);
            10.0 * (0.05 * x).sin() * (0.06 * y + 0.002 * x).cos()
        });
        let prediction = Grid2::from_fn(150, 150, |c, r| truth.bilinear(c as f64 - 0.6, r as f64 + 1.35));
        let found = register(Method::Xyz, &prediction, &truth, ALL_HEIGHTS);
        assert!((found.dx_cells - 0.6).abs() < 0.02 && (found.dy_cells + 1.35).abs() < 0.02, "{found:?}");
    }

    #[test]
    fn noise_and_holes_do_not_shift_the_prediction() {
        let truth = town(160);
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let prediction = Grid2::from_fn(160, 160, |c, r| {
            let noise = (0..12).map(|_| random()).sum::<f32>() - 6.0;
            if random() < 0.2 { f32::NAN } else { truth.at(c, r) + 0.3 * noise + 2.0 }
        });
        let found = register(Method::Xyz, &prediction, &truth, ALL_HEIGHTS);
        assert!(found.dx_cells.abs() < 0.02 && found.dy_cells.abs() < 0.02, "{found:?}");
        assert!((found.dz_m + 2.0).abs() < 0.02, "{found:?}");
    }

    /// Smooth ground without noise of its own in the truth, and blocks and waves on it in the prediction.
    #[test]
    fn ground_without_relief_is_not_moved() {
        let plain = Grid2::from_fn(150, 150, |c, r| 0.02 * c as f32 + 0.01 * r as f32);
        let town = town(150);
        let prediction = Grid2::from_fn(150, 150, |c, r| {
            let block = if town.at(c, r) > 14.0 { 6.0 } else { 0.0 };
            plain.at(c, r) + block + 0.2 * (0.3 * c as f32).sin() * (0.23 * r as f32).cos()
        });
        for method in [Method::Ncc, Method::Xyz] {
            let found = register(method, &prediction, &plain, ALL_HEIGHTS);
            assert!(!found.is_determined, "{found:?}");
            assert!(found.dx_cells == 0.0 || found.dy_cells == 0.0 || method == Method::Xyz, "{found:?}");
        }
    }

    #[test]
    fn a_shift_far_beyond_the_grid_is_found() {
        let town = |c: i64, r: i64| {
            let (i, j) = (c.div_euclid(13), r.div_euclid(11));
            (i * 7 + j * 5 + i * j * 3).rem_euclid(11) as f32 * 2.5 + 0.02 * c as f32
        };
        let truth = Grid2::from_fn(160, 150, |c, r| town(c as i64, r as i64));
        for (dx, dy) in [(9, -6), (31, 17), (-45, 0)] {
            let prediction = Grid2::from_fn(160, 150, |c, r| town(c as i64 - dx, r as i64 - dy));
            let found = register(Method::Xyz, &prediction, &truth, ALL_HEIGHTS);
            assert_eq!((found.dx_cells, found.dy_cells), (dx as f64, dy as f64), "{found:?}");
        }
    }
}
