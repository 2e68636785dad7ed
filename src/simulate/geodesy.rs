//! Geodesy of the simulator: Earth-centred coordinates, sun position, directions on the map grid.
//!
//! It is independent of the module `frame` on purpose: a wrong sign or convention there must become visible in the images.
//! Only the map projection (PROJ) is shared.

use crate::frame::{Geodetic, Point, SiteGrid};
use crate::scene::Sun;
use nalgebra::Vector3;

/// Position of the town, east of the central meridian of its UTM zone, so that grid north and true north differ by 1.7°.
pub(super) const PLACE: Point<Geodetic> = Point::new(5.5, 43.3, 150.0);
/// Semi-major axis of WGS 84, metres.
const A_M: f64 = 6_378_137.0;
/// Flattening of WGS 84.
const F: f64 = 1.0 / 298.257_223_563;
/// First eccentricity squared.
const E2: f64 = F * (2.0 - F);

/// Earth-centred, Earth-fixed coordinates, metres.
pub(super) type Ecef = Vector3<f64>;

/// Unit vectors to the east, to the north and up.
#[derive(Clone, Copy, Debug)]
pub(super) struct LocalAxes {
    pub(super) east: Ecef,
    pub(super) north: Ecef,
    pub(super) up: Ecef,
}

/// Earth-centred coordinates of a geodetic point.
pub(super) fn ecef_from_geodetic(p: Point<Geodetic>) -> Ecef {
    let (lon, lat) = (p.lon_deg().to_radians(), p.lat_deg().to_radians());
    let normal = A_M / (1.0 - E2 * lat.sin().powi(2)).sqrt();
    let axis_distance = (normal + p.height_m()) * lat.cos();
    Ecef::new(
        axis_distance * lon.cos(),
        axis_distance * lon.sin(),
        (normal * (1.0 - E2) + p.height_m()) * lat.sin(),
    )
}

/// Geodetic coordinates of an Earth-centred point near the ground, by fixed-point iteration of the latitude.
pub(super) fn geodetic_from_ecef(p: Ecef) -> Point<Geodetic> {
    const ROUNDS: usize = 12;
    let axis_distance = p.x.hypot(p.y);
    let mut lat = p.z.atan2(axis_distance * (1.0 - E2));
    let mut height = 0.0;
    for _ in 0..ROUNDS {
        let normal = A_M / (1.0 - E2 * lat.sin().powi(2)).sqrt();
        height = axis_distance * lat.cos() + p.z * lat.sin() - A_M * A_M / normal;
        lat = p.z.atan2(axis_distance * (1.0 - E2 * normal / (normal + height)));
    }
    Point::new(p.y.atan2(p.x).to_degrees(), lat.to_degrees(), height)
}

/// Axes of the local horizon.
pub(super) fn local_axes(p: Point<Geodetic>) -> LocalAxes {
    let (lon, lat) = (p.lon_deg().to_radians(), p.lat_deg().to_radians());
    LocalAxes {
        east: Ecef::new(-lon.sin(), lon.cos(), 0.0),
        north: Ecef::new(-lat.sin() * lon.cos(), -lat.sin() * lon.sin(), lat.cos()),
        up: Ecef::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin()),
    }
}

impl LocalAxes {
    /// Unit vector of an azimuth (clockwise from true north) and an elevation, degrees.
    pub(super) fn direction(&self, azimuth_deg: f64, elevation_deg: f64) -> Ecef {
        let (az, el) = (azimuth_deg.to_radians(), elevation_deg.to_radians());
        (self.east * az.sin() + self.north * az.cos()) * el.cos() + self.up * el.sin()
    }
}

/// Unit vector to the sun in map axes (easting, northing, up) at a position, from the map coordinates of a second point
/// towards the sun.
pub(super) fn sun_on_map(grid: &SiteGrid, place: Point<Geodetic>, sun: Sun) -> [f64; 3] {
    const STEP_M: f64 = 50.0;
    let here = ecef_from_geodetic(place);
    let step = local_axes(place).direction(sun.azimuth_deg, sun.elevation_deg) * STEP_M;
    let on_map = |p: Ecef| grid.utm_from_geodetic(geodetic_from_ecef(p));
    let d = (on_map(here + step) - on_map(here - step)).xyz();
    let length = d.iter().map(|c| c * c).sum::<f64>().sqrt();
    d.map(|c| c / length)
}

/// Direction to the sun with an error of about 0.05° (NOAA's short formulas after Spencer, 1971).
pub(super) fn sun_at(day_of_year: u32, utc_h: f64, place: Point<Geodetic>) -> Sun {
    let year_angle = std::f64::consts::TAU / 365.0 * (f64::from(day_of_year) - 1.0 + (utc_h - 12.0) / 24.0);
    let (s1, c1) = year_angle.sin_cos();
    let (s2, c2) = (2.0 * year_angle).sin_cos();
    let (s3, c3) = (3.0 * year_angle).sin_cos();
    let equation_min =
        229.18 * (0.000_075 + 0.001_868 * c1 - 0.032_077 * s1 - 0.014_615 * c2 - 0.040_849 * s2);
    let declination = 0.006_918 - 0.399_912 * c1 + 0.070_257 * s1 - 0.006_758 * c2 + 0.000_907 * s2
        - 0.002_697 * c3
        + 0.001_48 * s3;
    let solar_h = utc_h + equation_min / 60.0 + place.lon_deg() / 15.0;
    let hour_angle = (15.0 * (solar_h - 12.0)).to_radians();
    let lat = place.lat_deg().to_radians();
    let up = lat.sin() * declination.sin() + lat.cos() * declination.cos() * hour_angle.cos();
    let east = -declination.cos() * hour_angle.sin();
    let north = lat.cos() * declination.sin() - lat.sin() * declination.cos() * hour_angle.cos();
    Sun {
        azimuth_deg: east.atan2(north).to_degrees().rem_euclid(360.0),
        elevation_deg: up.asin().to_degrees(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn earth_centred_coordinates_round_trip() {
        let back = geodetic_from_ecef(ecef_from_geodetic(PLACE));
        assert!((back.lon_deg() - 5.5).abs() < 1e-12 && (back.lat_deg() - 43.3).abs() < 1e-11);
        assert!((back.height_m() - 150.0).abs() < 1e-7);
    }

    #[test]
    fn the_grid_azimuth_of_the_sun_is_its_true_azimuth_minus_the_convergence() {
        // To first order, the convergence of UTM 31N at this position is (5.5° - 3°) sin(43.3°).
        let convergence_deg = 2.5 * 43.3f64.to_radians().sin();
        let grid = SiteGrid::at(PLACE).unwrap();
        let sun = Sun { azimuth_deg: 135.0, elevation_deg: 40.0 };
        let d = sun_on_map(&grid, PLACE, sun);
        let azimuth_deg = d[0].atan2(d[1]).to_degrees();
        assert!((azimuth_deg - (135.0 - convergence_deg)).abs() < 2e-3, "{azimuth_deg}");
        assert!((d[2].asin().to_degrees() - 40.0).abs() < 0.02);
    }

    #[test]
    fn the_sun_position_agrees_with_almanacs() {
        // The elevation at noon is 90° - latitude ± declination, at solstices and equinoxes.
        let noon_utc = |equation_min: f64| 12.0 - 5.5 / 15.0 - equation_min / 60.0;
        let june = sun_at(172, noon_utc(-1.7), PLACE);
        assert!((june.elevation_deg - (90.0 - 43.3 + 23.44)).abs() < 0.1, "{june:?}");
        assert!((june.azimuth_deg - 180.0).abs() < 0.5, "{june:?}");
        let morning = sun_at(80, 9.0, PLACE);
        assert!(morning.azimuth_deg > 100.0 && morning.azimuth_deg < 150.0, "{morning:?}");
    }
}
