//! The bare ground under a surface model: buildings and trees are found by morphological filters and replaced by what the
//! ground around them says.
//!
//! An opening (the lowest value, then the highest of those, of the squares around a cell) removes what is narrower than its
//! square. Squares grow cell by cell; a cell that an opening lowers by more than the ground can fall off over that
//! distance is no ground. Two limits take turns:
//!
//! 1. *Objects up to 40 m wide*: slope times the whole radius, as in the simple morphological filter (SMRF; Pingel, Clarke,
//!    McBride 2013, doi:10.1016/j.isprsjprs.2012.12.002). It keeps steep ground, but also halls, which are wide and low.
//! 2. *Halls up to 120 m wide*, on what is left: slope times the step of the radius plus a constant, as in the
//!    progressive morphological filter (PMF; Zhang et al. 2003, doi:10.1109/TGRS.2003.810682).
//!
//! A smooth surface through the cells that remain is the first ground; cells of the surface model near it are ground (SMRF,
//! step 3), and a smooth surface fills the others.

mod fill;

use crate::io::{Grid2, Window, box_openings};
use crate::stats::interpolated_quantile;
use fill::fill_smoothly;

/// Cells of the filters are about this wide, metres (SMRF: 1 m). Finer ones are filtered by their lowest heights.
const FILTER_CELL_M: f64 = 1.0;
/// Largest radius of the filter of objects, metres (SMRF's default is 18).
const OBJECT_RADIUS_M: f64 = 20.0;
/// Steepest ground of this filter, at least; SMRF's optimal values of 15 scenes are between 0.05 and 0.45.
const OBJECT_SLOPE: f64 = 0.3;
/// Largest radius of the filter of halls, metres: terminals and factories are up to 120 m wide.
const HALL_RADIUS_M: f64 = 60.0;
/// Step of heights that is no object, metres (PMF: initial elevation difference).
const HALL_STEP_M: f64 = 0.5;
/// Steepest ground of this filter, at least: 31 degrees.
const HALL_SLOPE: f64 = 0.6;
/// Where the ground is steep, limits follow the median slope of means of blocks of 2^4 filter cells, in which trees and walls do
/// not count, so that mountains keep their ridges. An opening by squares lowers a slope along both axes, and ridges are
/// steeper than the median, hence the factor.
const STEEPNESS_HALVINGS: usize = 4;
const HALL_STEEPNESS: f64 = 3.0;
/// A cell that lies this much lower than its neighbours is a wrong height, metres for each metre of cell (SMRF: 5).
const PIT_SLOPE: f64 = 5.0;
/// Height above the first ground up to which a cell is ground, metres, and for each metre of slope (SMRF: 0.5 and 1.25).
const NEAR_M: f32 = 0.5;
const NEAR_SLOPE: f32 = 1.25;

/// Heights of the bare ground in metres: those of the surface where it shows ground, and a smooth surface under buildings
/// and trees. NaN where the surface is NaN.
///
/// `surface` is in metres, `cell_m` the side of a cell.
#[must_use]
pub fn bare_ground(surface: &Grid2, cell_m: f64) -> Grid2 {
    if surface.valid().next().is_none() {
        return surface.clone();
    }
    let factor = ((FILTER_CELL_M / cell_m).round() as usize).max(1);
    let first = first_ground(&lowest_of_blocks(surface, factor), cell_m * factor as f64);
    let slope = slopes(&first, cell_m * factor as f64);
    let offset = (factor as f64 - 1.0) / 2.0;
    let ground = Grid2::from_rows(surface.width, surface.height, |row, line| {
        let y = (row as f64 - offset) / factor as f64;
        for (col, out) in line.iter_mut().enumerate() {
            let x = (col as f64 - offset) / factor as f64;
            let near = NEAR_M + NEAR_SLOPE * at_border(&slope, x, y);
            let z = surface.at(col, row);
            let is_ground = (z - at_border(&first, x, y)).abs() <= near;
            *out = if is_ground { z } else { f32::NAN };
        }
    });
    let mut ground = if ground.valid().next().is_some() { fill_smoothly(ground) } else { ground };
    ground.data.iter_mut().zip(&surface.data).filter(|(_, z)| z.is_nan()).for_each(|(g, _)| *g = f32::NAN);
    ground
}

/// The smooth surface through the cells that are no objects; NaN in none.
fn first_ground(surface: &Grid2, cell_m: f64) -> Grid2 {
    let known = fill_smoothly(surface.clone());
    let negative = map(&known, |z| -z);
    let pits = lowered(&negative, 1, |_| PIT_SLOPE * cell_m);
    let known = fill_smoothly(without(&known, &pits));
    let cells = |radius_m: f64| (radius_m / cell_m) as usize;
    let steepness = steepness(&known, cell_m);
    let slope = OBJECT_SLOPE.max(steepness);
    let objects = lowered(&known, cells(OBJECT_RADIUS_M), |radius| slope * radius as f64 * cell_m);
    let ground = fill_smoothly(without(&known, &objects));
    let limit = HALL_SLOPE.max(HALL_STEEPNESS * steepness) * cell_m + HALL_STEP_M;
    // Beyond the border the ground goes on as it does inside. Otherwise its higher end would be an object.
    let margin = cells(HALL_RADIUS_M);
    let halls = lowered(&continued(&ground, margin), margin, |_| limit);
    let inside = Window { col: margin, row: margin, width: ground.width, height: ground.height };
    fill_smoothly(without(&ground, &halls.window(inside)))
}

/// 1 in the cells that one of the openings of growing radius lowers by more than the limit of its radius, else 0.
fn lowered(surface: &Grid2, most: usize, limit: impl Fn(usize) -> f64) -> Grid2 {
    let mut found = Grid2::filled(surface.width, surface.height, 0.0);
    let mut last = surface.clone();
    for radius in 1..=most {
        let opened = box_openings(&last, radius);
        let limit = limit(radius) as f32;
        for (found, (before, after)) in found.data.iter_mut().zip(last.data.iter().zip(&opened.data)) {
            if before - after > limit {
                *found = 1.0;
            }
        }
        last = opened;
    }
    found
}

/// The median slope of the surface at large.
fn steepness(surface: &Grid2, cell_m: f64) -> f64 {
    let mut means = surface.clone();
    for _ in 0..STEEPNESS_HALVINGS {
        means = means.halved();
    }
    if means.data.is_empty() {
        return 0.0;
    }
    interpolated_quantile(&slopes(&means, cell_m * (1 << STEEPNESS_HALVINGS) as f64).data, 0.5)
}

/// A surface without the cells that are marked by 1; the surface itself if all are.
fn without(surface: &Grid2, marked: &Grid2) -> Grid2 {
    if marked.data.iter().all(|m| *m > 0.0) {
        return surface.clone();
    }
    let mut out = surface.clone();
    out.data.iter_mut().zip(&marked.data).filter(|(_, m)| **m > 0.0).for_each(|(z, _)| *z = f32::NAN);
    out
}

/// The lowest heights of blocks of `factor` x `factor` cells; NaN where all are.
fn lowest_of_blocks(surface: &Grid2, factor: usize) -> Grid2 {
    let (width, height) = (surface.width.div_ceil(factor), surface.height.div_ceil(factor));
    Grid2::from_rows(width, height, |row, line| {
        let rows = row * factor..((row + 1) * factor).min(surface.height);
        for (col, out) in line.iter_mut().enumerate() {
            let cols = col * factor..((col + 1) * factor).min(surface.width);
            let block = rows.clone().flat_map(|r| &surface.row(r)[cols.clone()]);
            *out = block.copied().fold(f32::NAN, f32::min);
        }
    })
}

/// A grid with a margin of cells in which it goes on as it does inside: mirrored in the cells of its border.
fn continued(surface: &Grid2, margin: usize) -> Grid2 {
    // Place of the cell, and of that of the border in which it is mirrored.
    let mirror = |at: usize, cells: usize| {
        let (at, last) = (at as i64 - margin as i64, cells as i64 - 1);
        let border = at.clamp(0, last);
        ((2 * border - at).clamp(0, last) as usize, border as usize, at != border)
    };
    let size = [surface.width, surface.height].map(|n| n + 2 * margin);
    Grid2::from_rows(size[0], size[1], |row, line| {
        let (inner_row, border_row, below) = mirror(row, surface.height);
        for (col, out) in line.iter_mut().enumerate() {
            let (inner_col, border_col, beside) = mirror(col, surface.width);
            let inner = surface.at(inner_col, inner_row);
            *out = if below || beside { 2.0 * surface.at(border_col, border_row) - inner } else { inner };
        }
    })
}

/// Slopes in metres per metre, by central differences.
fn slopes(surface: &Grid2, cell_m: f64) -> Grid2 {
    let at = |col: i64, row: i64| {
        surface.get(col.clamp(0, surface.width as i64 - 1), row.clamp(0, surface.height as i64 - 1))
    };
    let span = 2.0 * cell_m as f32;
    Grid2::from_rows(surface.width, surface.height, |row, line| {
        let row = row as i64;
        for (col, out) in line.iter_mut().enumerate() {
            let col = col as i64;
            *out = (at(col + 1, row) - at(col - 1, row)).hypot(at(col, row + 1) - at(col, row - 1)) / span;
        }
    })
}

/// A value between cells, beyond the centres of the outermost cells that of the border.
fn at_border(grid: &Grid2, x: f64, y: f64) -> f32 {
    grid.bilinear(x.clamp(0.0, grid.width as f64 - 1.0), y.clamp(0.0, grid.height as f64 - 1.0))
}

fn map(grid: &Grid2, of_one: impl Fn(f32) -> f32) -> Grid2 {
    Grid2 { width: grid.width, height: grid.height, data: grid.data.iter().map(|z| of_one(*z)).collect() }
}

#[cfg(test)]
mod tests;
