//! Reading of georeferences: GPS positions in photographs, lists of image positions, given similarities.

use super::draft::{Draft, named};
use super::error::PerspectiveError;
use super::georeference::{Georeference, LON_LAT, MapSimilarity, Position, fit_positions};
use super::options::GeoreferenceSource;
use super::pose::Pose;
use super::similarity::SimilarityTransform;
use crate::io::{ImageFile, ReadError, is_metric_map, read_text};
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::path::Path;

/// A similarity to map coordinates as a file states it: `map = scale * rotation * file + translation`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SimilarityFile {
    epsg: u32,
    scale: f64,
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

/// Finds the georeference of the scene at `scene` with some views and points.
pub(super) fn georeference(
    scene: &Path,
    source: &GeoreferenceSource,
    views: &[Draft],
    points: &[DVec3],
) -> Result<Georeference, PerspectiveError> {
    let map = match source {
        GeoreferenceSource::Exif => from_exif(scene, views)?,
        GeoreferenceSource::File(path) => from_file(path, views)?,
    };
    let centers: Vec<DVec3> = views.iter().map(|v| v.pose.center).collect();
    Georeference::new(map, if points.is_empty() { &centers } else { points })
}

/// The fit to the positions that photographs state in their EXIF. Altitudes are taken as heights above the ellipsoid,
/// which they are in EXIF 3.0 unless the reference says sea level.
fn from_exif(scene: &Path, views: &[Draft]) -> Result<MapSimilarity, PerspectiveError> {
    let mut pairs = Vec::new();
    for view in views {
        let file = ImageFile::open(&view.image)?;
        let item = |key: &str| file.metadata(&format!("EXIF_GPS{key}"), "");
        if let Some(position) = exif_position(item) {
            pairs.push((view.pose.center, position));
        }
    }
    fit_positions(scene, LON_LAT, &pairs)
}

/// Longitude, latitude, altitude of the EXIF items `Latitude`, `LatitudeRef`, …, written as GDAL does: `(46) (50) (33.9)`.
fn exif_position(item: impl Fn(&str) -> Option<String>) -> Option<Position> {
    let numbers = |key: &str| -> Option<Vec<f64>> {
        let text = item(key)?;
        text.split(['(', ')', ' ']).filter(|w| !w.is_empty()).map(|w| w.parse().ok()).collect()
    };
    let degrees = |key: &str, negative: &str| {
        let parts = numbers(key)?;
        let value = parts.iter().zip([1.0, 60.0, 3600.0]).map(|(part, unit)| part / unit).sum::<f64>();
        let sign = if item(&format!("{key}Ref"))?.trim().eq_ignore_ascii_case(negative) { -1.0 } else { 1.0 };
        Some(sign * value)
    };
    let altitude = *numbers("Altitude")?.first()?;
    // 1 and 3 are below the ellipsoid and below sea level.
    let is_below = item("AltitudeRef").is_some_and(|r| r.ends_with(['1', '3']));
    Some([degrees("Longitude", "W")?, degrees("Latitude", "S")?, if is_below { -altitude } else { altitude }])
}

/// The similarity of a file: JSON, or a list of image positions.
fn from_file(path: &Path, views: &[Draft]) -> Result<MapSimilarity, PerspectiveError> {
    let text = read_text(path)?;
    if text.trim_start().starts_with('{') {
        let given = serde_json::from_str(&text).map_err(|e| ReadError::new(path, e))?;
        given_similarity(path, &given)
    } else {
        let (epsg, pairs) = listed_positions(path, &text, views)?;
        fit_positions(path, epsg, &pairs)
    }
}

fn given_similarity(path: &Path, given: &SimilarityFile) -> Result<MapSimilarity, PerspectiveError> {
    if !is_metric_map(given.epsg) {
        let found = given.epsg.to_string();
        return Err(PerspectiveError::field(path, "`epsg`", found, "the code of a map projection in metres"));
    }
    if !(given.scale.is_finite() && given.scale > 0.0) {
        return Err(PerspectiveError::field(path, "`scale`", given.scale.to_string(), "a number above zero"));
    }
    let rows: Vec<[f64; 4]> =
        given.rotation.iter().zip(given.translation).map(|(r, t)| [r[0], r[1], r[2], t]).collect();
    let pose = Pose::from_camera_to_world(&rows).map_err(|(found, expected)| {
        PerspectiveError::field(path, "`rotation`, `translation`", found, expected)
    })?;
    let rotation: DMat3 = pose.cam_from_world.transpose();
    let fitted = SimilarityTransform { scale: given.scale, rotation, translation: pose.center, rms: 0.0 };
    Ok(MapSimilarity { epsg: given.epsg, fitted, positions: 0 })
}

/// The EPSG code of a list, and camera centres with the positions that it states: a line `EPSG:CODE`, then lines
/// `image easting northing height` (`longitude latitude height` for EPSG:4326), as in OpenDroneMap's `geo.txt`. Images
/// that are not in the scene are left out.
fn listed_positions(
    path: &Path,
    text: &str,
    views: &[Draft],
) -> Result<(u32, Vec<(DVec3, Position)>), PerspectiveError> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    let mut lines = numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (number, first) = lines.next().unwrap_or((1, ""));
    let code = first
        .get(..5)
        .filter(|p| p.eq_ignore_ascii_case("EPSG:"))
        .and_then(|_| first[5..].trim().parse().ok());
    let epsg = code.ok_or_else(|| {
        let expected = "`EPSG:` and the code of the coordinates, such as `EPSG:32633`";
        PerspectiveError::field(path, format!("line {number}"), format!("`{first}`"), expected)
    })?;
    let mut pairs = Vec::new();
    for (number, line) in lines {
        let words: Vec<&str> = line.split([' ', '\t', ',']).filter(|w| !w.is_empty()).collect();
        let position = match words.as_slice() {
            [_, x, y, z, ..] => match (x.parse(), y.parse(), z.parse()) {
                (Ok(x), Ok(y), Ok(z)) => Some([x, y, z]),
                _ => None,
            },
            _ => None,
        };
        let position = position.ok_or_else(|| {
            let expected = "an image, easting, northing and height";
            PerspectiveError::field(path, format!("line {number}"), format!("`{line}`"), expected)
        })?;
        let name = words.first().copied().unwrap_or_default();
        if let Some(place) = named(path, views, name)? {
            pairs.push((views[place].pose.center, position));
        }
    }
    Ok((epsg, pairs))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_of_exif_have_the_signs_of_their_hemispheres() {
        let items = |key: &str| {
            let text = match key {
                "Latitude" => "(46) (50) (33.9993)",
                "LatitudeRef" => "S",
                "Longitude" => "(91) (59) (39.4778)",
                "LongitudeRef" => "W",
                "Altitude" => "(12.5)",
                "AltitudeRef" => "0x01",
                _ => return None,
            };
            Some(text.to_owned())
        };
        let [lon, lat, height] = exif_position(items).unwrap();
        assert!((lon + 91.994_299_388_9).abs() < 1e-9 && (lat + 46.842_777_583_3).abs() < 1e-9);
        assert!((height + 12.5).abs() < 1e-12);
        assert_eq!(exif_position(|key| if key == "Altitude" { None } else { items(key) }), None);
    }
}
