//! Map projections and datum transforms, by PROJ.

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
                Proj::new_known_crs(&format!("EPSG:{}", self.from), &format!("EPSG:{}", self.to), None).ok()
            });
            f(entry.as_ref())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
