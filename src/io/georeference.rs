//! The georeference of files whose format has none, as PLY, OBJ and glTF: `NAME.georef.json` beside `NAME.ply`.

use super::{ReadError, WriteError, read_json, write_file};
use crate::frame::{Point, SiteGrid};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The members of the file that place its coordinates.
#[derive(Deserialize)]
struct Georeference {
    epsg: u32,
    origin: Origin,
}

#[derive(Deserialize)]
struct Origin {
    easting_m: f64,
    northing_m: f64,
    height_m: f64,
}

/// The file with the georeference of `path`.
fn beside(path: &Path) -> PathBuf {
    path.with_extension("georef.json")
}

/// One line that tells people where the coordinates of a file in the site frame are; for comments in its header.
#[must_use]
pub fn georeference_comment(site: &SiteGrid) -> String {
    let [east, north, height] = site.origin.xyz();
    let epsg = site.epsg;
    format!(
        "satgs site frame: metres east, north, up of EPSG:{epsg} {east} {north}, ellipsoidal height {height}"
    )
}

/// The site frame as JSON.
#[must_use]
pub fn georeference(site: &SiteGrid) -> serde_json::Value {
    let [east, north, height] = site.origin.xyz();
    serde_json::json!({
        "epsg": site.epsg,
        "origin": { "easting_m": east, "northing_m": north, "height_m": height },
        "axes": ["east", "north", "up"],
        "unit": "m",
        "vertical_reference": "WGS 84 ellipsoid",
        "grid_convergence_deg": site.convergence_deg(),
    })
}

/// Writes the georeference of a file in the site frame beside it.
///
/// # Errors
/// [`WriteError`] if it cannot be written.
pub fn write_georeference(path: &Path, site: &SiteGrid) -> Result<(), WriteError> {
    let georef = georeference(site);
    write_file(&beside(path), format!("{georef:#}\n"))
}

/// Whether the georeference of `path`, or that it has none, would replace another one that is there.
#[must_use]
pub fn replaces_georeference(path: &Path, site: Option<&SiteGrid>) -> bool {
    let beside = beside(path);
    let there = || read_json::<serde_json::Value>(&beside).ok();
    beside.exists() && site.is_none_or(|site| there() != Some(georeference(site)))
}

/// Reads the georeference beside a file; none if there is none.
///
/// # Errors
/// [`ReadError`] if it is there and cannot be read, or a coordinate is not finite.
pub fn read_georeference(path: &Path) -> Result<Option<SiteGrid>, ReadError> {
    let georef = beside(path);
    if !georef.exists() {
        return Ok(None);
    }
    let Georeference { epsg, origin } = read_json(&georef)?;
    let origin = Point::new(origin.easting_m, origin.northing_m, origin.height_m);
    if !origin.is_finite() {
        return Err(ReadError::new(&georef, "a coordinate of `origin` is not a finite number"));
    }
    Ok(Some(SiteGrid { epsg, origin }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_georeference_is_read_as_it_was_written_and_damage_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        assert_eq!(read_georeference(&path).unwrap(), None);
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.5, 3_357_611.25, -20.5) };
        write_georeference(&path, &site).unwrap();
        assert_eq!(read_georeference(&path).unwrap(), Some(site));
        std::fs::write(beside(&path), "{\"epsg\": 32617}").unwrap();
        assert!(read_georeference(&path).unwrap_err().to_string().contains("origin"));
    }
}
