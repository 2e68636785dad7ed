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

impl Prior {
    /// Scale of the robust loss, metres: splats much further from the surface are hardly pulled.
    pub const SCALE_M: f64 = 1.0;

    /// The prior of a matched surface.
    #[must_use]
    pub fn new(surface: &MatchedSurface) -> Self {
        let MatchedSurface { site, grid, altitude, prior_weight, .. } = surface;
        let cells = altitude.data.iter().zip(&prior_weight.data).map(|(z, weight)| [*z, *weight]).collect();
        let (origin, corner) = ([site.origin.x(), site.origin.y()], [grid.west, grid.north]);
        Self { origin, corner, cell_m: grid.cell, width: grid.width, height: grid.height, cells }
    }

    /// Signed vertical distance from the surface in units of [`Prior::SCALE_M`], and the weight at a position in the site frame
    /// (metres); none where there is no surface or the weight is zero.
    #[inline]
    pub fn distance<T: Real>(&self, [x, y, z]: [T; 3]) -> Option<(T, T)> {
        let col = (self.origin[0] + x.as_f64() - self.corner[0]) / self.cell_m;
        let row = (self.corner[1] - (self.origin[1] + y.as_f64())) / self.cell_m;
        // Also false for NaN.
        let is_within = col >= 0.0 && row >= 0.0 && col < self.width as f64 && row < self.height as f64;
        if !is_within {
            return None;
        }
        let cell = self.cells[row as usize * self.width + col as usize];
        let [altitude, weight] = cell.map(|v| T::from_f64(v.into()));
        let r = (z - altitude) / T::from_f64(Self::SCALE_M);
        (weight > T::zero() && !r.is_nan()).then_some((r, weight))
    }
}
