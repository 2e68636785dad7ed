//! The surface of the surface prior.

use crate::mvs::MatchedSurface;
use crate::simd::Real;

/// The surface of the prior: altitudes and weights on a map grid.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Map coordinates of the site's origin, metres east and north.
    origin: [f64; 2],
    /// Map coordinates of the north-western corner of the grid.
    corner: [f64; 2],
    cell_m: f64,
    width: usize,
    height: usize,
    /// Altitude and weight of each cell, row by row. They stand together, because splats read them in no order.
    cells: Vec<[f32; 2]>,
}

/// The cells of a [`Prior`].
#[derive(Clone, Copy, Debug)]
pub struct PriorCells<'a> {
    /// North-western corner of the grid, site metres east and north.
    pub corner: [f64; 2],
    /// Side of a cell, metres.
    pub cell_m: f64,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Altitude (metres) and weight of each cell, row by row.
    pub cells: &'a [[f32; 2]],
}

impl Prior {
    /// Scale of the robust loss, metres: splats much further from the surface are hardly pulled.
    pub const SCALE_M: f64 = 1.0;

    /// The prior of a matched surface.
    #[must_use]
    pub fn new(surface: &MatchedSurface) -> Self {
        let MatchedSurface { site, grid, altitude, prior_weight, .. } = surface;
        debug_assert_eq!([altitude.data.len(), prior_weight.data.len()], [grid.width * grid.height; 2]);
        let cells = altitude.data.iter().zip(&prior_weight.data).map(|(z, weight)| [*z, *weight]).collect();
        let (origin, corner) = ([site.origin.x(), site.origin.y()], [grid.west, grid.north]);
        Self { origin, corner, cell_m: grid.cell, width: grid.width, height: grid.height, cells }
    }

    /// The cells.
    #[must_use]
    pub fn cells(&self) -> PriorCells<'_> {
        let corner = [0, 1].map(|k| self.corner[k] - self.origin[k]);
        PriorCells { corner, cell_m: self.cell_m, size: (self.width, self.height), cells: &self.cells }
    }

    /// Signed vertical distances from the surface in units of [`Prior::SCALE_M`], and the weights, at positions in the site frame
    /// (metres); both are zero where there is no surface or the weight is zero.
    #[inline(always)]
    pub fn distances<T: Real, const N: usize>(&self, positions: &[[T; 3]; N]) -> ([T; N], [T; N]) {
        // Three loops: the first and the last are computed in registers, and the second waits for memory only.
        let mut places = [[0.0; 2]; N];
        // The sums are in the order of `SiteGrid::utm_from_site` and `MapGrid::corner_px_from_utm`, so that the cells are the same.
        for (place, [x, y, _]) in places.iter_mut().zip(positions) {
            let col = (self.origin[0] + x.as_f64() - self.corner[0]) / self.cell_m;
            let row = (self.corner[1] - (self.origin[1] + y.as_f64())) / self.cell_m;
            *place = [col, row];
        }
        let size = [self.width, self.height].map(|n| n as f64);
        let mut cells = [[f32::NAN; 2]; N];
        for (cell, [col, row]) in cells.iter_mut().zip(places) {
            // Also false for NaN.
            if col >= 0.0 && row >= 0.0 && col < size[0] && row < size[1] {
                *cell = self.cells[row as usize * self.width + col as usize];
            }
        }
        let (mut distances, mut weights) = ([T::zero(); N], [T::zero(); N]);
        for k in 0..N {
            let [altitude, weight] = cells[k].map(|v| T::from_f64(v.into()));
            let distance = (positions[k][2] - altitude) / T::from_f64(Self::SCALE_M);
            let has_weight = weight > T::zero() && !distance.is_nan();
            distances[k] = if has_weight { distance } else { T::zero() };
            weights[k] = if has_weight { weight } else { T::zero() };
        }
        (distances, weights)
    }
}
