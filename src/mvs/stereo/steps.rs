//! How many steps the matched surface has around each cell: many in towns and on cliffs, few on terrain.

use crate::io::{Grid2, box_sums};
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

#[cfg(test)]
mod tests {
    use super::*;

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
