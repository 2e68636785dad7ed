//! Filling of the cells for which no two views agree on an altitude.

use crate::io::Grid2;
use crate::mvs::plane_sweep::PlaneSweep;
use rayon::prelude::*;

/// Width of the gaps within a surface that are interpolated, cells.
const GAP_CELLS: i64 = 2;
/// Largest distance of the cells from which others are filled, metres.
const FILL_RADIUS_M: f64 = 40.0;
/// Rank, from the lowest, of the altitude that fills a cell among those found in eight directions: occluded
/// surfaces lie below what occludes them (Hirschmüller 2008, §2.6.3).
const FILL_RANK: usize = 1;
/// Number of directions in which an altitude must be found. Nothing is filled outside of the matched surface.
const MIN_FILL_DIRECTIONS: usize = 5;
/// Offsets (right, down) of the eight directions.
const DIRECTIONS: [(i64, i64); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

/// Closes gaps of up to [`GAP_CELLS`] cells, which the pixels of the maps leave within a surface: cells take
/// the mean altitude and score of both sides, if these differ by at most `max_step_m` metres.
pub(super) fn close_gaps(altitude: &mut Grid2, score: &mut Grid2, max_step_m: f32) {
    let (known, scores) = (altitude.clone(), score.clone());
    let width = known.width;
    let rows = altitude.data.par_chunks_mut(width).zip(score.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(row, (altitude, score))| {
        for (col, (z, s)) in altitude.iter_mut().zip(score).enumerate().filter(|(_, (z, _))| z.is_nan()) {
            let nearest = |c: i64, r: i64| {
                let cells = (1..=GAP_CELLS).map(|k| (col as i64 + c * k, row as i64 + r * k));
                let mut values = cells.map(|(c, r)| (known.get(c, r), scores.get(c, r)));
                values.find(|(z, _)| !z.is_nan())
            };
            let across = DIRECTIONS[..4].iter().filter_map(|(c, r)| nearest(*c, *r).zip(nearest(-c, -r)));
            let flattest = across.min_by(|(a, b), (c, d)| (a.0 - b.0).abs().total_cmp(&(c.0 - d.0).abs()));
            if let Some((a, b)) = flattest.filter(|(a, b)| (a.0 - b.0).abs() <= max_step_m) {
                (*z, *s) = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
            }
        }
    });
}

/// Fills cells without altitude from their surroundings, if at least two images cover the filled point. Their
/// score is 0.
pub(super) fn fill(sweep: &PlaneSweep, altitude: &mut Grid2, score: &mut Grid2) {
    let known = altitude.clone();
    let reach = (FILL_RADIUS_M / sweep.grid.cell) as i64;
    let filled = |col: usize, row: usize| {
        let along = |(c, r): &(i64, i64)| {
            let mut values = (1..=reach).map(|k| known.get(col as i64 + c * k, row as i64 + r * k));
            values.find(|z| !z.is_nan())
        };
        let mut found: Vec<f32> = DIRECTIONS.iter().filter_map(along).collect();
        found.sort_unstable_by(f32::total_cmp);
        if found.len() < MIN_FILL_DIRECTIONS { None } else { found.get(FILL_RANK).copied() }
    };
    let width = known.width;
    let rows = altitude.data.par_chunks_mut(width).zip(score.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(row, (altitude, score))| {
        for (col, (z, s)) in altitude.iter_mut().zip(score).enumerate().filter(|(_, (z, _))| z.is_nan()) {
            *s = 0.0;
            let Some(filled_z) = filled(col, row) else { continue };
            if sweep.covering_views(col, row, filled_z) >= 2 {
                *z = filled_z;
            }
        }
    });
}
