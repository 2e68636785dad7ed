//! Pictures and maps at another size.
//!
//! Each new pixel is a weighted mean of those around its place, by a triangle with a half-width of one pixel of the coarser of
//! both grids: bilinear interpolation where the grid becomes finer, a mean over the area where it becomes coarser.

use crate::io::Grid2;

/// The first pixel that a new pixel is made of, and the weights of those from there on.
type Weights = (usize, Vec<f32>);

/// A grid at another size; the outer borders of both are the same.
pub(super) fn resampled(plane: Grid2, width: usize, height: usize) -> Grid2 {
    if (plane.width, plane.height) == (width, height) {
        return plane;
    }
    let (columns, rows) = (weights(plane.width, width), weights(plane.height, height));
    let narrow = Grid2::from_rows(width, plane.height, |row, line| {
        let source = plane.row(row);
        for (out, (first, weights)) in line.iter_mut().zip(&columns) {
            *out = source[*first..].iter().zip(weights).map(|(value, weight)| value * weight).sum();
        }
    });
    Grid2::from_rows(width, height, |row, line| {
        let (first, weights) = &rows[row];
        for (k, weight) in weights.iter().enumerate() {
            for (out, value) in line.iter_mut().zip(narrow.row(first + k)) {
                *out += value * weight;
            }
        }
    })
}

/// What each of `to` pixels along an axis is made of `from` pixels.
fn weights(from: usize, to: usize) -> Vec<Weights> {
    let factor = from as f64 / to as f64;
    let reach = factor.max(1.0);
    let of = |i: usize| {
        let center = (i as f64 + 0.5) * factor - 0.5;
        let first = (center - reach).ceil().max(0.0) as usize;
        let last = ((center + reach).floor() as usize).min(from - 1);
        let weight = |k: usize| 1.0 - (k as f64 - center).abs() / reach;
        let sum: f64 = (first..=last).map(weight).sum();
        (first, (first..=last).map(|k| (weight(k) / sum) as f32).collect())
    };
    (0..to).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_a_mean_stays_the_mean() {
        let ramp = Grid2::from_fn(8, 6, |col, row| col as f32 + 10.0 * row as f32);
        let fine = resampled(ramp.clone(), 16, 12);
        assert!((fine.at(7, 5) - (3.25 + 22.5)).abs() < 1e-5, "{}", fine.at(7, 5));
        assert_eq!((fine.at(0, 0), fine.at(15, 11)), (0.0, 57.0));
        let coarse = resampled(ramp.clone(), 4, 3);
        assert!((coarse.at(1, 1) - (2.5 + 25.0)).abs() < 1e-5, "{}", coarse.at(1, 1));
        let stripes = Grid2::from_fn(64, 2, |col, _| (col % 2) as f32);
        let gray = resampled(stripes, 8, 2);
        assert!((1..7).all(|col| (gray.at(col, 0) - 0.5).abs() < 0.01), "{:?}", gray.data);
        assert_eq!(resampled(ramp.clone(), 8, 6), ramp);
    }
}
