//! What GDAL knows of coordinate systems.

use super::file::{set_up_gdal, transform};
use gdal::spatial_ref::SpatialRef;

/// EPSG code of the horizontal CRS that a WKT text describes.
#[must_use]
pub fn epsg_of_wkt(wkt: &str) -> Option<u32> {
    set_up_gdal();
    let mut srs = SpatialRef::from_wkt(wkt).ok()?;
    let of_part = srs.get_attr_value("PROJCS|AUTHORITY", 1).ok().flatten().and_then(|code| code.parse().ok());
    of_part.or_else(|| {
        // A compound system's own code would be that of map and heights together.
        let is_flat = !srs.is_compound() && srs.auto_identify_epsg().is_ok();
        is_flat.then(|| srs.auth_code().ok().and_then(|c| u32::try_from(c).ok())).flatten()
    })
}

/// Whether an EPSG code is a map projection in metres.
#[must_use]
pub fn is_metric_map(epsg: u32) -> bool {
    set_up_gdal();
    SpatialRef::from_epsg(epsg).is_ok_and(|s| s.is_projected() && (s.linear_units() - 1.0).abs() < 1e-9)
}

/// Height of the EGM96 geoid above the ellipsoid in metres; none without PROJ's grid of it.
#[must_use]
pub fn egm96_undulation_m(lon_deg: f64, lat_deg: f64) -> Option<f64> {
    set_up_gdal();
    let from = SpatialRef::from_definition("EPSG:4326+5773").ok()?;
    let to = SpatialRef::from_definition("EPSG:4979").ok()?;
    let (mut x, mut y, mut z) = ([lon_deg], [lat_deg], [0.0]);
    transform(from, to, &mut x, &mut y, &mut z)?;
    // Without the grid PROJ leaves heights as they are.
    (z[0] != 0.0 && z[0].is_finite()).then_some(z[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_horizontal_part_of_a_compound_system_is_found() {
        let wkt = |definition: &str| SpatialRef::from_definition(definition).unwrap().to_wkt().unwrap();
        assert_eq!(epsg_of_wkt(&wkt("EPSG:32617")), Some(32617));
        assert_eq!(epsg_of_wkt(&wkt("EPSG:32617+5703")), Some(32617));
        assert_eq!(epsg_of_wkt("nonsense"), None);
    }

    #[test]
    fn feet_and_degrees_are_no_metric_maps() {
        assert!(is_metric_map(32617));
        assert!(!is_metric_map(2236), "Florida East in US survey feet");
        assert!(!is_metric_map(4326));
        assert!(!is_metric_map(999_999));
    }
}
