//! How many steps the matched surface has around each cell: many in towns and on cliffs, few on terrain.

use crate::io::Grid2;
use rayon::prelude::*;

/// Distance at which altitudes are compared, metres, and their smallest difference that is a step: a slope of 63°.
const ACROSS_M: f64 = 2.0;
const STEP_M: f32 = 4.0;
/// A step is also larger than so many discontinuities, which noise may reach.
const STEP_DISCONTINUITIES: f32 = 2.0;

/// For every cell, the share of steps among the pairs of known altitudes [`ACROSS_M`] metres apart in the square of `radius`
/// cells around it; NaN where there is no pair.
pub(super) fn share_of_steps(altitude: &Grid2, cell_m: f64, discontinuity_m: f32, radius: usize) -> Grid2 {
    let across = (ACROSS_M / cell_m).round().max(1.0) as i64;
    let step_m = STEP_M.max(STEP_DISCONTINUITIES * discontinuity_m);
    let counted = |is_counted: &(dyn Fn(f32) -> bool + Sync)| {
        let counts = Grid2::from_rows(altitude.width, altitude.height, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let z = altitude.at(col, row);
                let others = [(across, 0), (0, across)];
                let others = others.map(|(c, r)| altitude.get(col as i64 + c, row as i64 + r));
                *out = others.iter().filter(|other| is_counted((*other - z).abs())).count() as f32;
            }
        });
        box_sums(&counts, radius)
    };
    // A difference is NaN if one altitude is unknown.
    let mut share = counted(&|difference| difference > step_m);
    let pairs = counted(&|difference| !difference.is_nan());
    share.data.par_iter_mut().zip(&pairs.data).for_each(|(steps, pairs)| *steps /= pairs);
    share
}

/// Sums over the squares of `radius` cells around every cell, as far as they lie in the grid.
fn box_sums(values: &Grid2, radius: usize) -> Grid2 {
    let along_rows = |grid: &Grid2| {
        Grid2::from_rows(grid.width, grid.height, |row, line| {
            let values = grid.row(row);
            let mut sum: f32 = values.iter().take(radius).sum();
            for (col, out) in line.iter_mut().enumerate() {
                sum += values.get(col + radius).unwrap_or(&0.0);
                *out = sum;
                sum -= col.checked_sub(radius).map_or(0.0, |first| values[first]);
            }
        })
    };
    let transposed = |grid: &Grid2| Grid2::from_fn(grid.height, grid.width, |col, row| grid.at(row, col));
    transposed(&along_rows(&transposed(&along_rows(values))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_are_those_of_the_squares_around_the_cells() {
        let values = Grid2::from_fn(7, 5, |col, row| (col + 10 * row) as f32);
        let sums = box_sums(&values, 2);
        for (col, row) in [(0, 0), (3, 2), (6, 4), (1, 3)] {
            let cells = (0..7).flat_map(|c| (0..5).map(move |r| (c, r)));
            let near = cells.filter(|(c, r): &(usize, usize)| c.abs_diff(col) <= 2 && r.abs_diff(row) <= 2);
            let expected: f32 = near.map(|(c, r)| values.at(c, r)).sum();
            assert_eq!(sums.at(col, row), expected, "{col} {row}");
        }
    }

    #[test]
    fn a_town_has_steps_and_a_steep_slope_has_none() {
        let share = |z: fn(usize, usize) -> f32| {
            let altitude = Grid2::from_fn(90, 90, z);
            share_of_steps(&altitude, 0.5, 1.5, 20).at(45, 45)
        };
        assert_eq!(share(|col, row| 0.7 * (col + row) as f32), 0.0);
        assert!(share(|col, row| if col % 20 < 10 && row % 20 < 10 { 8.0 } else { 0.0 }) > 0.1);
        assert!(share(|_, _| f32::NAN).is_nan());
    }
}
