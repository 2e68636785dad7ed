//! EPSG codes and vertical parts of coordinate reference systems, by GDAL and PROJ.

use super::VerticalReference;
use super::gdal_setup::{set_up_gdal, transform};
use super::height_unit::{VerticalPart, metres_of};
use gdal::spatial_ref::SpatialRef;

/// EPSG code of the horizontal CRS that a WKT text describes; `None` if it has none, or the text is not valid.
#[must_use]
pub fn epsg_of_wkt(wkt: &str) -> Option<u32> {
    set_up_gdal();
    let srs = SpatialRef::from_wkt(wkt).ok()?;
    if srs.is_projected() {
        return epsg_of_map(&srs);
    }
    // The code of a compound CRS is that of map and heights together, so that the vertical part is removed first.
    (!srs.is_compound()).then(|| srs.auth_code().ok().and_then(|c| u32::try_from(c).ok())).flatten()
}

/// EPSG code of the map projection in a CRS without its vertical part: the code in the definition of the projection, or
/// that of an equivalent system that PROJ finds.
#[must_use]
pub(super) fn epsg_of_map(srs: &SpatialRef) -> Option<u32> {
    // If the projection has no code, GDAL returns that of a part, such as the datum; it must be checked.
    let own = srs.get_attr_value("PROJCS|AUTHORITY", 1).ok().flatten().and_then(|code| code.parse().ok());
    own.filter(|code| is_same_map(srs, *code)).or_else(|| identified(srs))
}

/// Whether an EPSG code is the same map projection as that of a CRS.
fn is_same_map(srs: &SpatialRef, code: u32) -> bool {
    let Ok(of_code) = SpatialRef::from_epsg(code) else { return false };
    if !of_code.is_projected() {
        return false;
    }
    let name = |s: &SpatialRef| s.get_attr_value("PROJCS", 0).ok().flatten();
    let same_name = name(srs).is_some() && name(srs) == name(&of_code);
    // Equal names suffice if both systems have one; otherwise both must give the same coordinates.
    same_name || puts_places_alike(srs, &of_code)
}

/// Whether two projections give the same coordinates, to a centimetre, at some positions in the area of use of the second.
fn puts_places_alike(a: &SpatialRef, b: &SpatialRef) -> bool {
    let Some(area) = b.area_of_use() else { return false };
    let middle = [
        0.5 * (area.west_lon_degree + area.east_lon_degree),
        0.5 * (area.south_lat_degree + area.north_lat_degree),
    ];
    let places = |srs: &SpatialRef| {
        let degrees = srs.geog_cs().ok()?;
        let mut x = [middle[0], 0.75 * middle[0] + 0.25 * area.west_lon_degree];
        let mut y = [middle[1], 0.75 * middle[1] + 0.25 * area.south_lat_degree];
        transform(degrees, flat(srs)?, &mut x, &mut y, &mut [])?;
        Some([x[0], x[1], y[0], y[1]])
    };
    let datum = |s: &SpatialRef| (s.semi_major().ok(), s.semi_minor().ok());
    let near = |p: [f64; 4], q: [f64; 4]| p.iter().zip(q).all(|(p, q)| (p - q).abs() < 0.01);
    datum(a) == datum(b) && places(a).zip(places(b)).is_some_and(|(p, q)| near(p, q))
}

/// A CRS without its vertical part.
#[allow(unsafe_code)]
fn flat(srs: &SpatialRef) -> Option<SpatialRef> {
    let copy = srs.clone();
    // SAFETY: the handle is that of `copy`, which outlives the calls.
    let code = unsafe {
        match srs.is_compound() {
            true => gdal_sys::OSRStripVertical(copy.to_c_hsrs()),
            false => gdal_sys::OSRDemoteTo2D(copy.to_c_hsrs(), std::ptr::null()),
        }
    };
    (code == gdal_sys::OGRErr::OGRERR_NONE).then_some(copy)
}

/// EPSG code of the system that PROJ identifies with a map projection without a code.
#[allow(unsafe_code)]
fn identified(srs: &SpatialRef) -> Option<u32> {
    /// Confidence of PROJ in percent at which two systems differ at most in their names.
    const SAME: i32 = 70;
    let flat = flat(srs)?;
    let (mut count, mut confidence) = (0, std::ptr::null_mut());
    // SAFETY: the handles are valid during the call, and its results are freed by the functions that GDAL documents.
    unsafe {
        let found =
            gdal_sys::OSRFindMatches(flat.to_c_hsrs(), std::ptr::null_mut(), &mut count, &mut confidence);
        if found.is_null() {
            return None;
        }
        let mut code = None;
        for i in 0..usize::try_from(count).unwrap_or(0) {
            if code.is_none() && *confidence.add(i) >= SAME {
                let name = gdal_sys::OSRGetAuthorityName(*found.add(i), std::ptr::null());
                let text = gdal_sys::OSRGetAuthorityCode(*found.add(i), std::ptr::null());
                if !name.is_null() && !text.is_null() && std::ffi::CStr::from_ptr(name) == c"EPSG" {
                    code = std::ffi::CStr::from_ptr(text).to_str().ok().and_then(|t| t.parse().ok());
                }
            }
        }
        gdal_sys::OSRFreeSRSArray(found);
        gdal_sys::VSIFree(confidence.cast());
        code
    }
}

/// The vertical part of a CRS: unit and reference of heights.
pub(super) fn vertical_part(srs: &SpatialRef) -> VerticalPart {
    let value = |path: &str, child| srs.get_attr_value(path, child).ok().flatten();
    let has_vertical = srs.is_compound() || srs.is_vertical();
    let Some(name) = value("VERT_CS", 0).filter(|_| has_vertical) else {
        // In a projected or geographic system with three axes, heights are ellipsoidal.
        let is_3d = !has_vertical && srs.axes_count() == 3;
        let from = is_3d.then(|| VerticalReference::ELLIPSOID.to_owned());
        return VerticalPart { from, metres: Some(1.0), ..VerticalPart::default() };
    };
    let datum = value("VERT_CS|VERT_DATUM", 0).unwrap_or_default();
    let datum = VerticalReference::known_name(&datum);
    let from = if VerticalReference::is_known(&datum) { datum } else { VerticalReference::known_name(&name) };
    let unit = value("VERT_CS|UNIT", 0).unwrap_or_default();
    let metres = value("VERT_CS|UNIT", 1).and_then(|v| v.parse().ok()).or_else(|| metres_of(&unit));
    VerticalPart { unit, metres, from: Some(from) }
}

/// Whether an EPSG code is a map projection in metres.
#[must_use]
pub fn is_metric_map(epsg: u32) -> bool {
    set_up_gdal();
    SpatialRef::from_epsg(epsg).is_ok_and(|s| s.is_projected() && (s.linear_units() - 1.0).abs() < 1e-9)
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
    fn the_code_of_a_datum_is_not_taken_for_that_of_the_map() {
        const BASE: &str = r#"GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563,
            AUTHORITY["EPSG","7030"]],AUTHORITY["EPSG","6326"]],PRIMEM["Greenwich",0],
            UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]"#;
        let map = |name: &str, lon: &str, east: &str| {
            format!(
                r#"PROJCS["{name}",{BASE},PROJECTION["Transverse_Mercator"],
                PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",{lon}],PARAMETER["scale_factor",0.9996],
                PARAMETER["false_easting",{east}],PARAMETER["false_northing",0],UNIT["metre",1]]"#
            )
        };
        assert_eq!(epsg_of_wkt(&map("UTM 31N", "3", "500000")), Some(32631), "identified by PROJ");
        assert_eq!(epsg_of_wkt(&map("ours", "4.5", "123456")), None, "no system of EPSG");
        let compound = format!(
            r#"COMPD_CS["both",{},VERT_CS["EGM96 height",VERT_DATUM["EGM96 geoid",2005],UNIT["metre",1]]]"#,
            map("UTM 31N", "3", "500000")
        );
        assert_eq!(epsg_of_wkt(&compound), Some(32631));
    }

    #[test]
    fn reference_and_unit_are_read_from_the_vertical_part() {
        let of = |definition: &str| vertical_part(&SpatialRef::from_definition(definition).unwrap());
        let from = |definition: &str| of(definition).from;
        assert_eq!(from("EPSG:32631"), None);
        assert_eq!(from("EPSG:32631+5773").as_deref(), Some("EGM96"));
        assert_eq!(from("EPSG:32631+3855").as_deref(), Some("EGM2008"));
        assert_eq!(from("EPSG:32631+5703").as_deref(), Some("NAVD88 height"));
        assert_eq!(from("EPSG:4979").as_deref(), Some("ellipsoid"));
        let feet = of("EPSG:32631+6360");
        assert!((feet.metres.unwrap() - 1200.0 / 3937.0).abs() < 1e-9, "{}", feet.unit);
        assert!((of("EPSG:32631+8228").metres.unwrap() - 0.3048).abs() < 1e-9);
    }

    #[test]
    fn systems_in_feet_and_degrees_are_not_metric_maps() {
        assert!(is_metric_map(32617));
        assert!(!is_metric_map(2236), "Florida East in US survey feet");
        assert!(!is_metric_map(4326));
        assert!(!is_metric_map(999_999));
    }
}
