//! Expected errors of the heights of a surface model.
//!
//! Heights are wrong where they were filled in, more so in the middle of large holes, and beside steps, where the outlines of
//! both sides are uncertain. The constants were chosen on four simulated towns of two views. On four others, of two and three
//! views, the rank correlation with the true error is 0.51 to 0.67, and the fifth of the cells with the largest expected
//! error holds 41 to 57 % of the errors above 2 m; a fifth cannot hold more than 57 to 100 % there.

use super::{Dsm, is_confirmed};
use crate::io::{Grid2, box_means, box_ranges};
use rayon::prelude::*;

/// Radii of the squares around a cell in which cells without a confirmed height are counted, metres: the larger those that
/// they fill, the larger is the hole.
const HOLE_RADII_M: [f64; 3] = [2.0, 4.0, 12.0];
/// Radius of the square in which heights are compared, metres.
const STEP_RADIUS_M: f64 = 1.0;
/// Expected error of confirmed cells of level ground: metres, or pixels between the views, whichever is more. A simulated
/// mountain has 0.06 pixels in views 4° apart, 0.13 in views 16° apart.
const CONFIRMED_M: f64 = 0.05;
const CONFIRMED_PX: f64 = 0.06;
/// Weight of the holes around a confirmed cell; that of a cell in a hole is 1.
const BESIDE_HOLES: f32 = 0.1;
/// Expected errors approach this one, metres: the height of a house.
const LARGEST_M: f32 = 8.0;

impl Dsm {
    /// Expected absolute error of every height after registration, metres; NaN where there is no height, and everywhere if views
    /// are not counted.
    #[must_use]
    pub fn expected_error(&self) -> Grid2 {
        let Grid2 { width, height, .. } = self.height;
        let views = &self.confidence.views;
        let cells = |metres: f64| (metres / self.grid.cell).round().max(1.0) as usize;
        let steps = box_ranges(&self.height, cells(STEP_RADIUS_M));
        let is_open = |views: f32| f32::from(u8::from(!is_confirmed(views)));
        let open = Grid2 { width, height, data: views.data.iter().map(|views| is_open(*views)).collect() };
        let shares = HOLE_RADII_M.map(|radius| box_means(&open, cells(radius)));
        let confirmed_m = CONFIRMED_M.max(CONFIRMED_PX * self.confidence.height_of_pixel_m) as f32;
        let of_cell = |i: usize| {
            if self.height.data[i].is_nan() || views.data[i].is_nan() {
                return f32::NAN;
            }
            let hole: f32 = shares.iter().map(|share| share.data[i]).sum();
            let weight = if open.data[i] > 0.0 { 1.0 } else { BESIDE_HOLES };
            let error = (confirmed_m + weight * hole) * (1.0 + steps.data[i]);
            error / (1.0 + error / LARGEST_M)
        };
        Grid2 { width, height, data: (0..width * height).into_par_iter().map(of_cell).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsm::render::tests::flat_surface;

    /// A surface in cells of half a metre, with the height and the number of views of every cell.
    fn surface(of_cell: impl Fn(usize) -> (f32, f32) + Sync) -> Dsm {
        let (mut surface, _) = flat_surface(80, 60);
        surface.height = Grid2::from_fn(80, 60, |col, _| of_cell(col).0);
        surface.confidence.views = Grid2::from_fn(80, 60, |col, _| of_cell(col).1);
        surface
    }

    #[test]
    fn confirmed_level_ground_has_a_small_error() {
        let error = surface(|_| (3.0, 2.0)).expected_error();
        assert!(error.data.iter().all(|e| (e - 0.05).abs() < 0.001));
    }

    #[test]
    fn views_of_a_small_angle_have_a_larger_error() {
        let mut level = surface(|_| (3.0, 2.0));
        level.confidence.height_of_pixel_m = 7.0;
        assert!((level.expected_error().at(5, 5) - 0.4).abs() < 0.03);
    }

    #[test]
    fn errors_grow_into_holes_and_beside_steps() {
        let hole = surface(|col| (3.0, if (30..60).contains(&col) { 0.0 } else { 2.0 })).expected_error();
        assert!(hole.at(5, 30) < hole.at(29, 30) && hole.at(29, 30) < hole.at(30, 30));
        assert!(hole.at(30, 30) < hole.at(45, 30) && hole.at(45, 30) < LARGEST_M);
        let step = surface(|col| (if col < 40 { 0.0 } else { 9.0 }, 2.0)).expected_error();
        assert!(step.at(40, 30) > 5.0 * step.at(20, 30));
    }

    #[test]
    fn what_is_not_known_has_no_error() {
        let error = surface(|col| (if col == 7 { f32::NAN } else { 1.0 }, 2.0)).expected_error();
        assert!(error.at(7, 5).is_nan() && !error.at(6, 5).is_nan());
        assert!(surface(|_| (1.0, f32::NAN)).expected_error().data.iter().all(|e| e.is_nan()));
    }
}
