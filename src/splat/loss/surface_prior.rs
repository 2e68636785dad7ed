//! What holds splats on plain surfaces: the surface that training starts on.
//!
//! Where nothing tells one altitude from another (a white roof), the views let splats drift by metres, though the edges
//! around are right; matching had bridged the plain part from there. A spring pulls splats back: strong near the
//! surface, weaker beyond a metre (Geman and McClure), and only where the surface bridges something plain.

use crate::frame::{Point, SiteGrid};
use crate::io::{MapGrid, Plane};
use crate::mvs::MatchedSurface;
use crate::splat::splats::Splats;
use rayon::prelude::*;

/// Distance beyond which the pull weakens, metres.
const REACH_M: f32 = 1.0;

/// The surface, on its grid in the site frame.
pub struct SurfacePrior {
    site: SiteGrid,
    grid: MapGrid,
    altitude: Plane,
    /// What the pull counts, 0 to 1.
    share: Plane,
    /// What the loss weighs the splats' mean distance.
    weight: f64,
}

impl SurfacePrior {
    /// Holds to `first` where it says so; the loss weighs the splats' mean distance by `weight`.
    #[must_use]
    pub fn new(first: &MatchedSurface, weight: f64) -> Self {
        let (altitude, share) = (first.altitude.clone(), first.hold.clone());
        Self { site: first.site, grid: first.grid, altitude, share, weight }
    }

    /// Adds to `gradient` the derivative by the altitudes of the splats' weighted mean distance from the surface,
    /// `r² / (r² + 1)` at `r` metres.
    pub fn pull(&self, splats: &Splats, gradient: &mut Splats) {
        let scale = (self.weight / splats.len().max(1) as f64) as f32;
        let rows = splats.position.par_iter().zip(&mut gradient.position).with_min_len(1024);
        rows.for_each(|(position, by)| by[2] += scale * self.slope(*position));
    }

    fn slope(&self, [x, y, z]: [f32; 3]) -> f32 {
        let place = self.site.utm_from_site(Point::new(f64::from(x), f64::from(y), 0.0));
        let px = self.grid.corner_px_from_utm(place);
        let (col, row) = (px.col.floor() as i64, px.row.floor() as i64);
        let r = (z - self.altitude.get(col, row)) / REACH_M;
        let slope = 2.0 * r / (REACH_M * (r * r + 1.0).powi(2));
        let pull = self.share.get(col, row) * slope;
        if pull.is_nan() { 0.0 } else { pull }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two cells of 2 m at an altitude of 5 m, of which the western one holds.
    fn hold() -> SurfacePrior {
        let site = SiteGrid { epsg: 32617, origin: Point::new(1000.0, 2000.0, 10.0) };
        let grid = MapGrid { epsg: 32617, west: 998.0, north: 2001.0, cell: 2.0, width: 2, height: 1 };
        let plane = |data: [f32; 2]| Plane { width: 2, height: 1, data: data.into() };
        let (altitude, score) = (plane([5.0; 2]), plane([1.0; 2]));
        SurfacePrior::new(&MatchedSurface { site, grid, altitude, score, hold: plane([1.0, 0.0]) }, 0.4)
    }

    #[test]
    fn the_pull_is_the_slope_of_the_distance() {
        let hold = hold();
        let distance = |z: f64| (z - 5.0).powi(2) / ((z - 5.0).powi(2) + 1.0);
        for z in [3.0f32, 4.6, 5.0, 5.3, 9.0] {
            let quotient = (distance(f64::from(z) + 1e-5) - distance(f64::from(z) - 1e-5)) / 2e-5;
            assert!((f64::from(hold.slope([-1.0, 0.5, z])) - quotient).abs() < 1e-6, "{z}");
        }
    }

    #[test]
    fn what_has_texture_or_lies_beyond_the_surface_is_free() {
        let hold = hold();
        assert_eq!(hold.slope([1.0, 0.5, 5.5]), 0.0);
        assert_eq!(hold.slope([-1.0, 3.0, 5.5]), 0.0);
    }

    #[test]
    fn the_pull_is_shared_among_the_splats() {
        let mut splats = Splats::zeros(2);
        splats.position = vec![[-1.0, 0.0, 5.5], [1.0, 0.0, 5.5]];
        let mut gradient = Splats::zeros(2);
        hold().pull(&splats, &mut gradient);
        assert!((gradient.position[0][2] - 0.2 * 1.0 / 1.5625).abs() < 1e-6);
        assert_eq!(gradient.position[1][2], 0.0);
    }
}
