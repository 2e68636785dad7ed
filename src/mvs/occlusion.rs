//! Occlusion of the cells of a surface: from a view, or from the sun.
//!
//! Rays are marched over the height map. The maxima of blocks of cells let a ray skip blocks that are too low
//! to occlude it.

use crate::io::Grid2;
use multiversion::multiversion;
use rayon::prelude::*;
use std::ops::Range;

/// A cell may lie this far below [`occlusion_height`] and still count as visible, metres.
pub const OCCLUSION_TOLERANCE_M: f32 = 0.5;
/// Number of cells at the start of a ray that do not occlude. At a blurred edge the nearest cells are too
/// high, and would occlude the cell itself.
const SKIPPED_CELLS: usize = 2;

/// Side of the blocks whose maxima are known, cells.
const BLOCK: usize = 8;

/// The altitude in each cell from which on the cell is visible along rays whose ground displacement is
/// `slope` (metres east and north per metre of height).
///
/// `surface` holds altitudes in metres on a grid with cells of `cell` metres, from north to south; NaN cells
/// do not occlude. The result is negative infinity where nothing occludes a cell.
#[must_use]
pub fn occlusion_height(surface: &Grid2, [east, north]: [f64; 2], cell: f64) -> Grid2 {
    let slope = [east / cell, -north / cell];
    let top = surface.valid().fold(f32::NEG_INFINITY, f32::max);
    let maxima = block_maxima(surface);
    let mut out = Grid2::filled(surface.width, surface.height, f32::NEG_INFINITY);
    out.data.par_chunks_mut(surface.width).enumerate().for_each(|(row, line)| {
        occlusion_of_row(surface, &maxima, slope, top, row, line);
    });
    out
}

/// The highest altitude of each block and the eight blocks around it. A ray that starts in the block does not
/// leave these within [`BLOCK`] steps.
fn block_maxima(surface: &Grid2) -> Grid2 {
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

/// [`occlusion_height`] of the cells of a row. `slope` is in cells (right, down) per metre; `top` is the
/// highest altitude of the surface.
#[multiversion(targets("x86_64+avx2+fma"))]
fn occlusion_of_row(
    surface: &Grid2,
    maxima: &Grid2,
    slope: [f64; 2],
    top: f32,
    row: usize,
    line: &mut [f32],
) {
    let length = slope[0].hypot(slope[1]).max(1e-6);
    let (right, down) = (slope[0] / length, slope[1] / length);
    let rise = (1.0 / length) as f32;
    let max_steps = surface.width.max(surface.height);
    for (col, highest) in line.iter_mut().enumerate() {
        let cell = |n: usize| {
            let along = |from: usize, step: f64| (from as f64 + step * n as f64).round_ties_even() as i64;
            (along(col, right), along(row, down))
        };
        for first in (SKIPPED_CELLS..max_steps).step_by(BLOCK) {
            let up = rise * first as f32;
            let (c, r) = cell(first);
            let near = maxima.get(c.div_euclid(BLOCK as i64), r.div_euclid(BLOCK as i64));
            // The maxima are NaN outside of the grid. A ray that has left the grid does not come back.
            if top - up <= *highest || near.is_nan() {
                break;
            }
            if near - up <= *highest {
                continue;
            }
            for n in first..first + BLOCK {
                let (c, r) = cell(n);
                // `max` ignores NaN.
                *highest = highest.max(surface.get(c, r) - rise * n as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_occludes_the_cells_behind_it_up_to_the_line_of_sight() {
        let wall = Grid2::from_fn(40, 3, |col, _| if col == 20 { 10.0 } else { 0.0 });
        let h = occlusion_height(&wall, [1.0, 0.0], 2.0);
        assert_eq!((h.at(15, 1), h.at(17, 1)), (10.0 - 10.0, 10.0 - 6.0));
        assert_eq!(h.at(30, 1), -4.0, "nothing but the ground lies to the right");
    }

    #[test]
    fn skipping_blocks_gives_the_same_result_as_marching_cell_by_cell() {
        let town = Grid2::from_fn(70, 45, |col, row| match (col / 5 * 7 + row / 4 * 5) % 11 {
            0 => f32::NAN,
            block => 3.0 * block as f32 + 0.1 * (col % 7) as f32,
        });
        for slope in [[0.9, 0.2], [-0.3, 0.8], [0.1, -0.05], [-2.0, -1.0]] {
            let length = 2.0 * f64::hypot(slope[0], slope[1]);
            let (right, down, rise) =
                (2.0 * slope[0] / length, -2.0 * slope[1] / length, (1.0 / length) as f32);
            let cell =
                |from: usize, step: f64, n: usize| (from as f64 + step * n as f64).round_ties_even() as i64;
            let step_by_step = Grid2::from_fn(70, 45, |col, row| {
                let all = (SKIPPED_CELLS..70)
                    .map(|n| town.get(cell(col, right, n), cell(row, down, n)) - rise * n as f32);
                all.fold(f32::NEG_INFINITY, f32::max)
            });
            assert_eq!(occlusion_height(&town, slope, 0.5), step_by_step, "{slope:?}");
        }
    }

    #[test]
    fn nothing_is_occluded_from_the_nadir() {
        let h = occlusion_height(&Grid2::filled(20, 20, 30.0), [0.0, 0.0], 0.5);
        assert!(h.data.iter().all(|h| *h < -1e3));
    }
}
