//! What hides a cell from a view, or from the sun.

use crate::raster::Plane;
use multiversion::multiversion;
use rayon::prelude::*;

/// A cell may lie this much below its horizon and still count as seen, metres.
pub const SLACK_M: f32 = 0.5;
/// Cells nearest to a point, which a coarse edge may have raised together with it, hide it never.
const NEAREST: usize = 2;

/// Altitude from which on a cell sees the sky along rays that lean `lean` metres (east, north) a metre of height, on
/// a grid of cells of `cell` metres. NaN cells of `surface` hide nothing.
#[must_use]
pub fn horizon(surface: &Plane, [east, north]: [f64; 2], cell: f64) -> Plane {
    let lean = [east / cell, -north / cell];
    let top = surface.valid().fold(f32::NEG_INFINITY, f32::max);
    let mut out = Plane::filled(surface.width, surface.height, f32::NEG_INFINITY);
    out.data.par_chunks_mut(surface.width).enumerate().for_each(|(row, line)| {
        horizon_of_row(surface, lean, top, row, line);
    });
    out
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn horizon_of_row(surface: &Plane, lean: [f64; 2], top: f32, row: usize, line: &mut [f32]) {
    let length = lean[0].hypot(lean[1]).max(1e-6);
    let (right, down) = (lean[0] / length, lean[1] / length);
    let rise = (1.0 / length) as f32;
    let across = surface.width.max(surface.height);
    for (col, highest) in line.iter_mut().enumerate() {
        for n in NEAREST..across {
            let up = rise * n as f32;
            if top - up <= *highest {
                break;
            }
            let c = (col as f64 + right * n as f64).round_ties_even() as i64;
            let r = (row as f64 + down * n as f64).round_ties_even() as i64;
            // NaN never is the greater.
            *highest = highest.max(surface.get(c, r) - up);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_hides_the_cells_behind_it_up_to_the_line_of_sight() {
        let wall = Plane::from_fn(40, 3, |col, _| if col == 20 { 10.0 } else { 0.0 });
        let h = horizon(&wall, [1.0, 0.0], 2.0);
        assert_eq!((h.at(15, 1), h.at(17, 1)), (10.0 - 10.0, 10.0 - 6.0));
        assert_eq!(h.at(30, 1), -4.0, "nothing but the ground lies to the right");
    }

    #[test]
    fn nadir_views_are_hidden_by_nothing() {
        let h = horizon(&Plane::filled(20, 20, 30.0), [0.0, 0.0], 0.5);
        assert!(h.data.iter().all(|h| *h < -1e3));
    }
}
