//! A level frame at a place of the ellipsoid, and where it stands in earth-centred coordinates.

use super::{Ecef, Geodetic, Point};
use glam::{DMat3, DVec3};

/// Semi-major axis, metres, and flattening of the WGS 84 ellipsoid (EPSG:7030).
const A: f64 = 6_378_137.0;
const F: f64 = 1.0 / 298.257_223_563;

/// Metres to the true east, to the true north and up at an origin: the axes of a plane that touches the ellipsoid's parallel
/// surface there, so that far points lie below those of the same height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelFrame {
    origin: DVec3,
    /// Its columns are the directions of east, north and up.
    ecef_from_level: DMat3,
}

impl LevelFrame {
    /// The level frame at a point.
    #[must_use]
    pub fn at(origin: Point<Geodetic>) -> Self {
        let ((sin_lon, cos_lon), (sin_lat, cos_lat)) =
            (origin.lon_deg().to_radians().sin_cos(), origin.lat_deg().to_radians().sin_cos());
        let ecef_from_level = DMat3::from_cols(
            DVec3::new(-sin_lon, cos_lon, 0.0),
            DVec3::new(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat),
            DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat),
        );
        Self { origin: DVec3::from_array(Self::ecef_from_geodetic(origin).xyz()), ecef_from_level }
    }

    /// Earth-centred coordinates of a geodetic point.
    #[must_use]
    pub fn ecef_from_geodetic(p: Point<Geodetic>) -> Point<Ecef> {
        let ((sin_lon, cos_lon), (sin_lat, cos_lat)) =
            (p.lon_deg().to_radians().sin_cos(), p.lat_deg().to_radians().sin_cos());
        let squared_eccentricity = F * (2.0 - F);
        let prime_vertical = A / (1.0 - squared_eccentricity * sin_lat * sin_lat).sqrt();
        let from_axis = (prime_vertical + p.height_m()) * cos_lat;
        let z = (prime_vertical * (1.0 - squared_eccentricity) + p.height_m()) * sin_lat;
        Point::new(from_axis * cos_lon, from_axis * sin_lon, z)
    }

    /// Metres east, north and up of a geodetic point.
    #[must_use]
    pub fn level_from_geodetic(&self, p: Point<Geodetic>) -> [f64; 3] {
        let offset = DVec3::from_array(Self::ecef_from_geodetic(p).xyz()) - self.origin;
        (self.ecef_from_level.transpose() * offset).to_array()
    }

    /// The matrix from level metres to earth-centred coordinates, column by column, as glTF and 3D Tiles write it.
    #[must_use]
    pub fn ecef_from_level(&self) -> [f64; 16] {
        let [x, y, z] = [0, 1, 2].map(|k| self.ecef_from_level.col(k));
        let o = self.origin;
        [x.x, x.y, x.z, 0.0, y.x, y.y, y.z, 0.0, z.x, z.y, z.z, 0.0, o.x, o.y, o.z, 1.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expected values are those of `cs2cs EPSG:4979 EPSG:4978`.
    #[test]
    fn earth_centred_coordinates_agree_with_proj() {
        for (lon, lat, height, expected) in [
            (-81.66, 30.35, -20.0, [799_025.719_061, -5_450_481.004_228, 3_203_905.424_474]),
            (0.0, 90.0, 10.0, [0.0, 0.0, 6_356_762.314_245]),
        ] {
            let found = LevelFrame::ecef_from_geodetic(Point::new(lon, lat, height)).xyz();
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
        }
    }

    #[test]
    fn axes_are_east_north_and_up() {
        let origin = Point::new(-81.66, 30.35, -20.0);
        let level = LevelFrame::at(origin);
        let [east, north, up] = level.level_from_geodetic(Point::new(-81.66, 30.35, 30.0));
        assert!(east.abs() < 1e-6 && north.abs() < 1e-6 && (up - 50.0).abs() < 1e-6);
        let [east, north, up] = level.level_from_geodetic(Point::new(-81.65, 30.35, -20.0));
        // A hundredth of a degree along the parallel, curved to the north and down.
        assert!((east - 961.4).abs() < 0.5 && north > 0.0 && north < 0.1 && up < 0.0 && up > -0.1);
        let m = level.ecef_from_level();
        let at_50_m = [0, 1, 2].map(|k| m[12 + k] + 50.0 * m[8 + k]);
        let expected = LevelFrame::ecef_from_geodetic(Point::new(-81.66, 30.35, 30.0)).xyz();
        assert!(at_50_m.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6));
    }
}
