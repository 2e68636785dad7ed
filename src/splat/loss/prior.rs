//! The surface of the surface prior.

use crate::frame::{Point, SiteGrid};
use crate::io::{Grid2, MapGrid};
use crate::mvs::MatchedSurface;
use crate::simd::Real;

/// The surface of the prior: altitudes and weights on a UTM grid.
#[derive(Clone, Debug)]
pub struct Prior {
    site: SiteGrid,
    grid: MapGrid,
    altitude: Grid2,
    weight: Grid2,
}

impl Prior {
    /// Scale of the robust loss, metres: splats much further from the surface are hardly pulled.
    pub const SCALE_M: f64 = 1.0;

    /// The prior of a matched surface.
    #[must_use]
    pub fn new(surface: &MatchedSurface) -> Self {
        let (altitude, weight) = (surface.altitude.clone(), surface.prior_weight.clone());
        Self { site: surface.site, grid: surface.grid, altitude, weight }
    }

    /// Signed vertical distance from the surface in units of [`Prior::SCALE_M`], and the weight at a position in the site frame
    /// (metres); none where there is no surface or the weight is zero.
    pub fn distance<T: Real>(&self, [x, y, z]: [T; 3]) -> Option<(T, T)> {
        let place = self.site.utm_from_site(Point::new(x.as_f64(), y.as_f64(), 0.0));
        let px = self.grid.corner_px_from_utm(place);
        let (col, row) = (px.col.floor() as i64, px.row.floor() as i64);
        let [altitude, weight] =
            [&self.altitude, &self.weight].map(|plane| T::from_f64(plane.get(col, row).into()));
        let r = (z - altitude) / T::from_f64(Self::SCALE_M);
        (weight > T::zero() && !r.is_nan()).then_some((r, weight))
    }
}
