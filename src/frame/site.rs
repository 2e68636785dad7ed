//! The site frame: metres east, north and up from an origin on a map grid. Cameras and splats use this frame.

use super::crs::{FrameError, Transform, WGS84, utm_epsg};
use super::{Geodetic, Point, Site, Utm};
use serde::{Deserialize, Serialize};

/// A box in the site frame: west, south, east, north, metres from the origin.
pub type SiteBox = (f64, f64, f64, f64);

/// A UTM zone and an origin in it. Its methods convert between geodetic, map and site coordinates.
///
/// The axes of the site frame point along the map grid to the east and to the north, and up; the unit is metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SiteGrid {
    /// EPSG code of the UTM zone, e.g. 32617.
    pub epsg: u32,
    /// The site's origin: easting, northing, ellipsoidal height in metres.
    pub origin: Point<Utm>,
}

impl SiteGrid {
    /// The site frame with the given origin, in the UTM zone of the origin.
    ///
    /// # Errors
    /// [`FrameError`] if the origin is outside of UTM, or PROJ's database is missing.
    pub fn at(origin: Point<Geodetic>) -> Result<Self, FrameError> {
        Self::in_zone(utm_epsg(origin.lon_deg(), origin.lat_deg())?, origin)
    }

    /// The site frame with the given origin, in the map projection with the EPSG code `epsg`.
    ///
    /// # Errors
    /// [`FrameError::UnknownCrs`] if PROJ does not know the code.
    pub fn in_zone(epsg: u32, origin: Point<Geodetic>) -> Result<Self, FrameError> {
        let (e, n) = Transform::new(WGS84, epsg)?.convert(origin.lon_deg(), origin.lat_deg());
        Transform::new(epsg, WGS84)?;
        Ok(Self { epsg, origin: Point::new(e, n, origin.height_m()) })
    }

    /// Map coordinates of a geodetic point; NaN where the projection is not defined.
    #[must_use]
    pub fn utm_from_geodetic(&self, p: Point<Geodetic>) -> Point<Utm> {
        let (e, n) = Transform::new(WGS84, self.epsg)
            .map_or((f64::NAN, f64::NAN), |t| t.convert(p.lon_deg(), p.lat_deg()));
        Point::new(e, n, p.height_m())
    }

    /// Geodetic coordinates of a map point; NaN where the projection is not defined.
    #[must_use]
    pub fn geodetic_from_utm(&self, p: Point<Utm>) -> Point<Geodetic> {
        let (lon, lat) =
            Transform::new(self.epsg, WGS84).map_or((f64::NAN, f64::NAN), |t| t.convert(p.x(), p.y()));
        Point::new(lon, lat, p.z())
    }

    /// Map coordinates of a site point.
    #[must_use]
    pub fn utm_from_site(&self, p: Point<Site>) -> Point<Utm> {
        let (o, q) = (self.origin.xyz(), p.xyz());
        Point::new(o[0] + q[0], o[1] + q[1], o[2] + q[2])
    }

    /// Site coordinates of a map point.
    #[must_use]
    pub fn site_from_utm(&self, p: Point<Utm>) -> Point<Site> {
        let d = (p - self.origin).xyz();
        Point::new(d[0], d[1], d[2])
    }

    /// Site coordinates of a geodetic point.
    #[must_use]
    pub fn site_from_geodetic(&self, p: Point<Geodetic>) -> Point<Site> {
        self.site_from_utm(self.utm_from_geodetic(p))
    }

    /// Geodetic coordinates of a site point.
    #[must_use]
    pub fn geodetic_from_site(&self, p: Point<Site>) -> Point<Geodetic> {
        self.geodetic_from_utm(self.utm_from_site(p))
    }

    /// Meridian convergence at the origin, degrees; positive east of the central meridian on the northern hemisphere.
    ///
    /// The grid azimuth of a direction is its true azimuth minus the convergence.
    #[must_use]
    pub fn convergence_deg(&self) -> f64 {
        /// Step along the meridian for the difference quotient, degrees.
        const STEP_DEG: f64 = 0.005;
        let o = self.geodetic_from_utm(self.origin);
        let north = self.utm_from_geodetic(Point::new(o.lon_deg(), o.lat_deg() + STEP_DEG, 0.0));
        let south = self.utm_from_geodetic(Point::new(o.lon_deg(), o.lat_deg() - STEP_DEG, 0.0));
        let d = (north - south).xyz();
        -d[0].atan2(d[1]).to_degrees()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The expected values are those of `proj +proj=utm +zone=17 +ellps=WGS84`.
    #[test]
    fn utm_agrees_with_proj_and_round_trips() {
        let p = Point::<Geodetic>::new(-81.6637, 30.3487, -20.0);
        let site = SiteGrid::at(p).unwrap();
        assert_eq!(site.epsg, 32617);
        assert!((site.origin.x() - 436_211.942_605).abs() < 1e-3, "{:?}", site.origin);
        assert!((site.origin.y() - 3_357_611.839_477).abs() < 1e-3, "{:?}", site.origin);
        let q = site.geodetic_from_site(Point::new(100.0, -50.0, 3.0));
        let back = site.site_from_geodetic(q);
        assert!((back - Point::new(100.0, -50.0, 3.0)).norm() < 1e-6);
    }

    /// The expected values are those of `proj -V +proj=utm`.
    #[test]
    fn convergence_agrees_with_proj() {
        for (lon, lat, expected) in
            [(-81.6637, 30.3487, -0.335_353_27), (5.44, 43.26, 1.672_698_64), (55.65, -21.23, 0.488_932_13)]
        {
            let site = SiteGrid::at(Point::new(lon, lat, 0.0)).unwrap();
            assert!(
                (site.convergence_deg() - expected).abs() < 1e-5,
                "{lon} {lat} {}",
                site.convergence_deg()
            );
        }
    }
}
