//! The map from pixels of a resampled image to pixels of the original one: a polynomial of degree 2.

use crate::frame::{CenterPx, Pixel};
use nalgebra::{DMatrix, DVector};

/// Number of coefficients of a polynomial of degree 2 in two variables.
const TERMS: usize = 6;
/// Newton steps of the inverse, and the distance at which they end, pixels. The map is nearly affine.
const STEPS: usize = 8;
const CLOSE_PX: f64 = 1e-9;

/// A map from pixels of a resampled image to pixels of the original one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageMap {
    /// Coefficients of 1, u, v, uu, uv, vv for the column and the row, of pixels relative to `middle` in units of `scale`.
    terms: [[f64; TERMS]; 2],
    middle: [f64; 2],
    scale: f64,
}

impl ImageMap {
    /// The map that fits pairs (pixel of the resampled image, pixel of the original one) best, by least squares; none if they
    /// do not determine it. The resampled image has `size` columns and rows.
    #[must_use]
    pub fn fit(
        pairs: &[(Pixel<CenterPx>, Pixel<CenterPx>)],
        (width, height): (usize, usize),
    ) -> Option<Self> {
        let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
        let empty = Self { terms: Default::default(), middle, scale: 0.5 * width.max(height) as f64 };
        let rows: Vec<[f64; TERMS]> = pairs.iter().map(|(px, _)| empty.monomials(*px)).collect();
        let matrix = DMatrix::from_fn(rows.len(), TERMS, |r, c| rows[r][c]);
        let normal = (matrix.transpose() * &matrix).cholesky()?;
        let solve = |value: fn(&Pixel<CenterPx>) -> f64| {
            let right = DVector::from_iterator(pairs.len(), pairs.iter().map(|(_, px)| value(px)));
            let terms = normal.solve(&(matrix.transpose() * right));
            std::array::from_fn(|k| terms[k])
        };
        let map = Self { terms: [solve(|px| px.col), solve(|px| px.row)], ..empty };
        map.terms.as_flattened().iter().all(|v| v.is_finite()).then_some(map)
    }

    fn monomials(&self, px: Pixel<CenterPx>) -> [f64; TERMS] {
        let (u, v) = ((px.col - self.middle[0]) / self.scale, (px.row - self.middle[1]) / self.scale);
        [1.0, u, v, u * u, u * v, v * v]
    }

    /// The pixel of the original image that a pixel of the resampled one shows.
    #[must_use]
    pub fn original_from_resampled(&self, px: Pixel<CenterPx>) -> Pixel<CenterPx> {
        let monomials = self.monomials(px);
        let [col, row] = self.terms.map(|t| t.iter().zip(monomials).map(|(a, b)| a * b).sum());
        Pixel::new(col, row)
    }

    /// The pixel of the resampled image that shows a pixel of the original one; none where the map has no inverse.
    #[must_use]
    pub fn resampled_from_original(&self, px: Pixel<CenterPx>) -> Option<Pixel<CenterPx>> {
        let mut found = Pixel::new(self.middle[0], self.middle[1]);
        for _ in 0..STEPS {
            let at = self.original_from_resampled(found);
            let (d_col, d_row) = (px.col - at.col, px.row - at.row);
            if d_col.hypot(d_row) < CLOSE_PX {
                return Some(found);
            }
            let [_, u, v, ..] = self.monomials(found);
            // Derivatives of column and row.
            let [[a, b], [c, d]] = self.terms.map(|t| {
                [
                    (t[1] + 2.0 * t[3] * u + t[4] * v) / self.scale,
                    (t[2] + t[4] * u + 2.0 * t[5] * v) / self.scale,
                ]
            });
            let det = a * d - b * c;
            found = Pixel::new(
                found.col + (d * d_col - b * d_row) / det,
                found.row + (a * d_row - c * d_col) / det,
            );
        }
        (self.original_from_resampled(found).distance(px) < 1e-6).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_of_degree_2_is_found_from_its_pairs_and_inverted() {
        let truth = |p: Pixel<CenterPx>| {
            let (u, v) = (p.col, p.row);
            Pixel::new(3.0 + 1.01 * u - 0.2 * v + 1e-5 * u * v, 5.0 + 0.18 * u + 0.98 * v - 2e-5 * u * u)
        };
        let nodes = (0..36).map(|i| Pixel::new(f64::from(i % 6) * 100.0, f64::from(i / 6) * 80.0));
        let pairs: Vec<_> = nodes.map(|p| (p, truth(p))).collect();
        let map = ImageMap::fit(&pairs, (500, 400)).unwrap();
        for px in [Pixel::new(0.0, 0.0), Pixel::new(499.0, 100.0), Pixel::new(-20.0, 430.0)] {
            let original = map.original_from_resampled(px);
            assert!(original.distance(truth(px)) < 1e-9);
            assert!(map.resampled_from_original(original).unwrap().distance(px) < 1e-6);
        }
        assert_eq!(ImageMap::fit(&pairs[..5], (500, 400)), None);
    }
}
