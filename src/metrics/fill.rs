//! Filling of holes with the value of the nearest valid cell, by an exact Euclidean distance transform that keeps the index
//! of the nearest cell (Felzenszwalb and Huttenlocher 2012: lower envelope of parabolas, columns first, then rows).

use crate::io::Grid2;
use rayon::prelude::*;
use std::ops::Range;

/// The raster with every NaN replaced by the value of the nearest valid cell; a raster without valid cells is unchanged.
#[must_use]
pub fn filled_by_nearest(raster: &Grid2) -> Grid2 {
    let (w, h) = (raster.width, raster.height);
    let nearest_row = nearest_valid_row(raster);
    Grid2::from_rows(w, h, |row, line| {
        line.copy_from_slice(raster.row(row));
        if !line.iter().any(|v| v.is_nan()) {
            return;
        }
        let rows: Vec<u32> = nearest_row
            .iter()
            .flat_map(|strip| strip.chunks_exact(strip.len() / h).nth(row))
            .flatten()
            .copied()
            .collect();
        let sites: Vec<(usize, f64)> = rows
            .iter()
            .enumerate()
            .map(|(col, r)| (col, *r as usize))
            .filter(|(_, r)| *r < h)
            .map(|(col, r)| (col, (r.abs_diff(row) as f64).powi(2)))
            .collect();
        if sites.is_empty() {
            return;
        }
        let envelope = lower_envelope(&sites);
        let mut k = 0;
        for (col, v) in line.iter_mut().enumerate() {
            while k + 1 < envelope.len() && envelope[k + 1].1 < col as f64 {
                k += 1;
            }
            if v.is_nan() {
                let from = envelope[k].0;
                *v = raster.at(from, rows[from] as usize);
            }
        }
    })
}

/// Number of columns that one thread processes at a time.
const STRIP: usize = 64;

/// For every cell, the row of the nearest valid cell in its column; the height of the raster if the column has none.
///
/// The result is a list of strips of [`STRIP`] columns, each row by row.
fn nearest_valid_row(raster: &Grid2) -> Vec<Vec<u32>> {
    let strips = (0..raster.width).into_par_iter().step_by(STRIP);
    strips.map(|first| nearest_in_strip(raster, first..(first + STRIP).min(raster.width))).collect()
}

fn nearest_in_strip(raster: &Grid2, cols: Range<usize>) -> Vec<u32> {
    let (w, rows) = (cols.len(), raster.height);
    let h = rows as u32;
    let mut nearest = vec![h; w * rows];
    for row in 0..rows {
        for (col, v) in raster.row(row)[cols.clone()].iter().enumerate() {
            let i = row * w + col;
            nearest[i] = if !v.is_nan() {
                row as u32
            } else if row > 0 {
                nearest[i - w]
            } else {
                h
            };
        }
    }
    for row in (0..rows.saturating_sub(1)).rev() {
        for col in 0..w {
            let (i, below) = (row * w + col, nearest[(row + 1) * w + col]);
            let away = |r: u32| r.abs_diff(row as u32);
            if below < h && (nearest[i] == h || away(below) < away(nearest[i])) {
                nearest[i] = below;
            }
        }
    }
    nearest
}

/// The lower envelope of the parabolas `(x - col)² + height` of `sites`: the column of each parabola in it, and the position
/// from which on it is the lowest.
fn lower_envelope(sites: &[(usize, f64)]) -> Vec<(usize, f64)> {
    let mut hull: Vec<(usize, f64, f64)> = Vec::with_capacity(sites.len());
    for &(col, height) in sites {
        let q = col as f64;
        let mut begin = f64::NEG_INFINITY;
        while let Some(&(c, f, b)) = hull.last() {
            let p = c as f64;
            begin = ((height + q * q) - (f + p * p)) / (2.0 * (q - p));
            if begin > b {
                break;
            }
            hull.pop();
            begin = f64::NEG_INFINITY;
        }
        hull.push((col, height, begin));
    }
    hull.into_iter().map(|(c, _, b)| (c, b)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pseudo-random numbers that are the same on all machines.
    fn noise(i: usize) -> u32 {
        (i as u32).wrapping_mul(2_654_435_761).rotate_left(13).wrapping_mul(2_246_822_519)
    }

    #[test]
    fn every_hole_is_filled_from_a_nearest_valid_cell() {
        // The raster is wider than two strips.
        const W: usize = 2 * STRIP + 31;
        for keep in [3, 17, 200] {
            let p = Grid2::from_fn(W, 23, |c, r| {
                let i = r * W + c;
                if noise(i).is_multiple_of(keep) { i as f32 } else { f32::NAN }
            });
            let filled = filled_by_nearest(&p);
            for r in 0..23usize {
                for c in 0..W {
                    let d2 = |i: usize| (i % W).abs_diff(c).pow(2) + (i / W).abs_diff(r).pow(2);
                    let best = p.valid().map(|v| d2(v as usize)).min().unwrap();
                    assert_eq!(d2(filled.at(c, r) as usize), best, "cell {c} {r}");
                }
            }
        }
    }

    #[test]
    fn a_raster_without_valid_cells_is_unchanged() {
        let p = Grid2::filled(4, 3, f32::NAN);
        assert_eq!(filled_by_nearest(&p).valid().count(), 0);
    }
}
