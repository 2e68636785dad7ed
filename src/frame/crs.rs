//! Map projections and datum transforms, by PROJ.

use super::proj_log;
use proj::Proj;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Why a coordinate transform or a geoid grid is not available.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FrameError {
    /// PROJ does not know one of the two systems.
    #[error("no transform from EPSG:{from} to EPSG:{to}")]
    #[diagnostic(help(
        "`projinfo EPSG:{from}` and `projinfo EPSG:{to}` show whether PROJ's database has both systems"
    ))]
    UnknownCrs {
        /// Source EPSG code.
        from: u32,
        /// Target EPSG code.
        to: u32,
    },
    /// PROJ cannot read the grid of a geoid.
    #[error("`{path}` is not a geoid grid that PROJ can read")]
    #[diagnostic(help(
        "a geoid grid is a .gtx file, or a GeoTIFF in degrees as those of cdn.proj.org, whose band is `geoid_undulation` in `metre` if it has a description and a unit"
    ))]
    GeoidGrid {
        /// The file.
        path: PathBuf,
    },
    /// The position is outside of the area that UTM covers.
    #[error("longitude {lon_deg}, latitude {lat_deg} lies outside UTM (80° south to 84° north)")]
    #[diagnostic(help("are longitude and latitude swapped?"))]
    OutsideUtm {
        /// Longitude, degrees.
        lon_deg: f64,
        /// Latitude, degrees.
        lat_deg: f64,
    },
}

/// EPSG code of the WGS 84 UTM zone of a longitude and a latitude in degrees.
///
/// # Errors
/// [`FrameError::OutsideUtm`] near the poles, and for numbers that are not a longitude and a latitude.
pub fn utm_epsg(lon_deg: f64, lat_deg: f64) -> Result<u32, FrameError> {
    if !(-80.0..=84.0).contains(&lat_deg) || !(-360.0..=360.0).contains(&lon_deg) {
        return Err(FrameError::OutsideUtm { lon_deg, lat_deg });
    }
    let wrapped = (lon_deg + 180.0).rem_euclid(360.0);
    let zone = (wrapped / 6.0).floor().min(59.0) as u32 + 1;
    Ok(if lat_deg >= 0.0 { 32600 } else { 32700 } + zone)
}

/// Wraps a longitude, or a difference of longitudes, into [-180, 180), degrees.
#[must_use]
pub fn wrap_longitude_deg(lon_deg: f64) -> f64 {
    if lon_deg.abs() <= 180.0 { lon_deg } else { (lon_deg + 180.0).rem_euclid(360.0) - 180.0 }
}

/// EPSG code of WGS 84 longitude and latitude in degrees.
pub(super) const WGS84: u32 = 4326;

/// A horizontal transform by PROJ between two EPSG systems. Axes are in the order (east, north) or (longitude, latitude),
/// in the units of the systems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Transform {
    from: u32,
    to: u32,
}

thread_local! {
    /// PROJ objects of this thread; they cannot be shared between threads, and creating one takes milliseconds.
    static CACHE: RefCell<BTreeMap<(u32, u32), Option<Proj>>> = const { RefCell::new(BTreeMap::new()) };
}

impl Transform {
    /// The transform from the system with the EPSG code `from` to that with the code `to`.
    ///
    /// # Errors
    /// [`FrameError::UnknownCrs`] if PROJ does not know one of them.
    pub fn new(from: u32, to: u32) -> Result<Self, FrameError> {
        let t = Self { from, to };
        if t.with_proj(|p| p.is_some()) { Ok(t) } else { Err(FrameError::UnknownCrs { from, to }) }
    }

    /// Transforms the position (`x`, `y`); NaN where the projection is not defined.
    #[must_use]
    pub fn convert(&self, x: f64, y: f64) -> (f64, f64) {
        self.with_proj(|p| p.and_then(|p| p.convert((x, y)).ok())).unwrap_or((f64::NAN, f64::NAN))
    }

    fn with_proj<T>(&self, f: impl FnOnce(Option<&Proj>) -> T) -> T {
        CACHE.with_borrow_mut(|cache| {
            let entry = cache.entry((self.from, self.to)).or_insert_with(|| {
                proj_log::silence();
                Proj::new_known_crs(&format!("EPSG:{}", self.from), &format!("EPSG:{}", self.to), None).ok()
            });
            f(entry.as_ref())
        })
    }
}

/// How far the unit of a map may be from a metre on the ground: that of UTM is within 0.1 %, those of national grids within
/// 0.2 %, that of Web Mercator is half a metre at 60 degrees.
const METRIC_WITHIN: f64 = 0.01;
/// Half the step of differences of positions on a map, in its units.
const HALF_STEP: f64 = 50.0;

/// The step on a map to which a unit along x and a unit along y of another map lead, at a position of the latter: two vectors
/// (x, y).
///
/// # Errors
/// [`FrameError::UnknownCrs`] if PROJ does not know one of the maps.
pub fn map_step(from: u32, to: u32, [x, y]: [f64; 2]) -> Result<[[f64; 2]; 2], FrameError> {
    let transform = Transform::new(from, to)?;
    let along = |dx: f64, dy: f64| {
        let (a, b) = (transform.convert(x - dx, y - dy), transform.convert(x + dx, y + dy));
        [(b.0 - a.0) / (2.0 * HALF_STEP), (b.1 - a.1) / (2.0 * HALF_STEP)]
    };
    Ok([along(HALF_STEP, 0.0), along(0.0, HALF_STEP)])
}

/// The EPSG code of the UTM zone of a position on a map.
///
/// # Errors
/// [`FrameError::UnknownCrs`] if PROJ does not know the map, [`FrameError::OutsideUtm`].
pub fn utm_of_map(epsg: u32, [x, y]: [f64; 2]) -> Result<u32, FrameError> {
    let (lon, lat) = Transform::new(epsg, WGS84)?.convert(x, y);
    utm_epsg(lon, lat)
}

/// Metres on the ground of a unit of a map in metres at a position; 1 where that is a metre but for the small scale of the
/// projection, and near the poles, which UTM does not reach.
///
/// # Errors
/// [`FrameError::UnknownCrs`] if PROJ does not know the map.
pub fn metres_of_unit(epsg: u32, at: [f64; 2]) -> Result<f64, FrameError> {
    let zone = match utm_of_map(epsg, at) {
        Err(FrameError::OutsideUtm { .. }) => return Ok(1.0),
        zone => zone?,
    };
    let [a, b] = map_step(epsg, zone, at)?;
    let unit = (a[0] * b[1] - a[1] * b[0]).abs().sqrt();
    Ok(if !unit.is_finite() || (unit - 1.0).abs() <= METRIC_WITHIN { 1.0 } else { unit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_of_web_mercator_shrinks_with_latitude() {
        let (x, y) = Transform::new(WGS84, 3857).unwrap().convert(5.44, 43.3);
        let unit = metres_of_unit(3857, [x, y]).unwrap();
        assert!((unit - 43.3f64.to_radians().cos()).abs() < 3e-3, "{unit}");
        let (x, y) = Transform::new(WGS84, 32631).unwrap().convert(5.44, 43.3);
        assert_eq!(metres_of_unit(32631, [x, y]).unwrap(), 1.0);
        let (x, y) = Transform::new(WGS84, 2154).unwrap().convert(5.44, 43.3);
        assert_eq!(metres_of_unit(2154, [x, y]).unwrap(), 1.0);
        // The axes of neighbouring zones are turned by the convergence of both.
        let (x, y) = Transform::new(WGS84, 32631).unwrap().convert(6.0, 43.3);
        let [east, north] = map_step(32631, 32632, [x, y]).unwrap();
        let turn = east[1].atan2(east[0]).to_degrees();
        assert!((turn.abs() - 6.0 * 43.3f64.to_radians().sin()).abs() < 0.02, "{turn}");
        assert!((north[0] + east[1]).abs() < 1e-3);
    }

    #[test]
    fn utm_zones_follow_longitude_and_hemisphere() {
        assert_eq!(utm_epsg(-81.66, 30.35).unwrap(), 32617);
        assert_eq!(utm_epsg(5.44, 43.26).unwrap(), 32631);
        assert_eq!(utm_epsg(55.65, -21.23).unwrap(), 32740);
        assert_eq!(utm_epsg(180.0, 0.0).unwrap(), 32601);
        assert!(utm_epsg(30.35, -81.66).is_err());
        assert!(utm_epsg(f64::NAN, 0.0).is_err());
    }

    #[test]
    fn unknown_code_is_an_error() {
        assert!(Transform::new(4326, 999_999).is_err());
    }
}
