//! What hides a cell from a view, or from the sun.

use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// A cell may lie this much below its horizon and still count as seen, metres.
pub const OCCLUSION_TOLERANCE_M: f32 = 0.5;
/// Cells nearest to a point, which a coarse edge may have raised together with it, hide it never.
const NEAREST: usize = 2;

/// Side of the blocks whose tops are known: rays pass those that hide nothing in one step.
const BLOCK: usize = 8;

/// Altitude from which on a cell sees the sky along rays that lean `lean` metres (east, north) a metre of height, on
/// a grid of cells of `cell` metres. NaN cells of `surface` hide nothing.
#[must_use]
pub fn occlusion_height(surface: &Grid2, [east, north]: [f64; 2], cell: f64) -> Grid2 {
    let lean = [east / cell, -north / cell];
    let top = surface.valid().fold(f32::NEG_INFINITY, f32::max);
    let tops = tops(surface);
    let mut out = Grid2::filled(surface.width, surface.height, f32::NEG_INFINITY);
    out.data.par_chunks_mut(surface.width).enumerate().for_each(|(row, line)| {
        occlusion_of_row(surface, &tops, lean, top, row, line);
    });
    out
}

/// The highest altitude of each block and the eight around it, which a ray cannot leave within [`BLOCK`] steps.
fn tops(surface: &Grid2) -> Grid2 {
    let (width, height) = (surface.width.div_ceil(BLOCK), surface.height.div_ceil(BLOCK));
    let highest = |plane: &Grid2, cols: Range<i64>, rows: Range<i64>| {
        let all = rows.flat_map(|row| cols.clone().map(move |col| plane.get(col, row)));
        all.fold(f32::NEG_INFINITY, f32::max)
    };
    let cells = |block: usize| (block * BLOCK) as i64..((block + 1) * BLOCK) as i64;
    let around = |block: usize| block as i64 - 1..block as i64 + 2;
    let own = Grid2::from_fn(width, height, |col, row| highest(surface, cells(col), cells(row)));
    Grid2::from_fn(width, height, |col, row| highest(&own, around(col), around(row)))
}

#[multiversion(targets("x86_64+avx2+fma"))]
fn occlusion_of_row(surface: &Grid2, tops: &Grid2, lean: [f64; 2], top: f32, row: usize, line: &mut [f32]) {
    let length = lean[0].hypot(lean[1]).max(1e-6);
    let (right, down) = (lean[0] / length, lean[1] / length);
    let rise = (1.0 / length) as f32;
    let across = surface.width.max(surface.height);
    for (col, highest) in line.iter_mut().enumerate() {
        let cell = |n: usize| {
            let along = |from: usize, step: f64| (from as f64 + step * n as f64).round_ties_even() as i64;
            (along(col, right), along(row, down))
        };
        for first in (NEAREST..across).step_by(BLOCK) {
            let up = rise * first as f32;
            let (c, r) = cell(first);
            let near = tops.get(c.div_euclid(BLOCK as i64), r.div_euclid(BLOCK as i64));
            // A ray that has left the grid, where tops are NaN, does not come back.
            if top - up <= *highest || near.is_nan() {
                break;
            }
            if near - up <= *highest {
                continue;
            }
            for n in first..first + BLOCK {
                let (c, r) = cell(n);
                // NaN never is the greater.
                *highest = highest.max(surface.get(c, r) - rise * n as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_hides_the_cells_behind_it_up_to_the_line_of_sight() {
        let wall = Grid2::from_fn(40, 3, |col, _| if col == 20 { 10.0 } else { 0.0 });
        let h = occlusion_height(&wall, [1.0, 0.0], 2.0);
        assert_eq!((h.at(15, 1), h.at(17, 1)), (10.0 - 10.0, 10.0 - 6.0));
        assert_eq!(h.at(30, 1), -4.0, "nothing but the ground lies to the right");
    }

    #[test]
    fn blocks_that_are_passed_hide_nothing() {
        let town = Grid2::from_fn(70, 45, |col, row| match (col / 5 * 7 + row / 4 * 5) % 11 {
            0 => f32::NAN,
            block => 3.0 * block as f32 + 0.1 * (col % 7) as f32,
        });
        for lean in [[0.9, 0.2], [-0.3, 0.8], [0.1, -0.05], [-2.0, -1.0]] {
            let length = 2.0 * f64::hypot(lean[0], lean[1]);
            let (right, down, rise) =
                (2.0 * lean[0] / length, -2.0 * lean[1] / length, (1.0 / length) as f32);
            let cell =
                |from: usize, step: f64, n: usize| (from as f64 + step * n as f64).round_ties_even() as i64;
            let step_by_step = Grid2::from_fn(70, 45, |col, row| {
                let all = (NEAREST..70)
                    .map(|n| town.get(cell(col, right, n), cell(row, down, n)) - rise * n as f32);
                all.fold(f32::NEG_INFINITY, f32::max)
            });
            assert_eq!(occlusion_height(&town, lean, 0.5), step_by_step, "{lean:?}");
        }
    }

    #[test]
    fn nadir_views_are_hidden_by_nothing() {
        let h = occlusion_height(&Grid2::filled(20, 20, 30.0), [0.0, 0.0], 0.5);
        assert!(h.data.iter().all(|h| *h < -1e3));
    }
}
