//! Reading of georeferences: GPS positions in photographs, lists of image positions, given similarities.

use super::draft::{Draft, named};
use super::error::PerspectiveError;
use super::georeference::{Georeference, LON_LAT, MapSimilarity, fit_positions};
use super::options::GeoreferenceSource;
use super::pose::Pose;
use super::similarity::SimilarityTransform;
use super::stated_position::StatedPosition;
use crate::frame::metres_of_unit;
use crate::io::{ImageFile, ReadError, is_metric_map, read_text};
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::path::Path;

/// Place in a line of the horizontal accuracy; the vertical one follows.
const HORIZONTAL: usize = 7;

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

/// The fit to the positions that photographs state in their EXIF.
fn from_exif(scene: &Path, views: &[Draft]) -> Result<MapSimilarity, PerspectiveError> {
    let mut positions = Vec::new();
    for view in views {
        positions.extend(StatedPosition::of_photograph(
            &view.name,
            view.pose,
            &ImageFile::open(&view.image)?,
        ));
    }
    fit_positions(scene, LON_LAT, &positions)
}

/// The similarity of a file: JSON, or a list of image positions.
fn from_file(path: &Path, views: &[Draft]) -> Result<MapSimilarity, PerspectiveError> {
    let text = read_text(path)?;
    if text.trim_start().starts_with('{') {
        let given = serde_json::from_str(&text).map_err(|e| ReadError::new(path, e))?;
        given_similarity(path, &given)
    } else {
        let (epsg, positions) = listed_positions(path, &text, views)?;
        fit_positions(path, epsg, &positions)
    }
}

fn given_similarity(path: &Path, given: &SimilarityFile) -> Result<MapSimilarity, PerspectiveError> {
    if !is_metric_map(given.epsg) {
        let found = given.epsg.to_string();
        return Err(PerspectiveError::field(path, "`epsg`", found, "the code of a map projection in metres"));
    }
    let [east, north, _] = given.translation;
    // Of a translation that no map has, nothing is known.
    let unit_m = metres_of_unit(given.epsg, [east, north]).unwrap_or(1.0);
    if unit_m != 1.0 {
        let found = format!("{}, whose unit is {unit_m:.3} m on the ground there", given.epsg);
        return Err(PerspectiveError::field(path, "`epsg`", found, "a map whose unit is a metre, as UTM"));
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
    let transform = SimilarityTransform { scale: given.scale, rotation, translation: pose.center };
    Ok(MapSimilarity { epsg: given.epsg, transform, fit: None })
}

/// The EPSG code of a list, and the positions that it states: a line `EPSG:CODE`, then lines `image easting northing height`
/// (`longitude latitude height` for EPSG:4326), as in OpenDroneMap's `geo.txt`; there three angles may follow, and the
/// horizontal and vertical accuracy in metres. Images that are not in the scene are left out.
fn listed_positions(
    path: &Path,
    text: &str,
    views: &[Draft],
) -> Result<(u32, Vec<StatedPosition>), PerspectiveError> {
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
    let mut positions = Vec::new();
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
            let accuracy = |k: usize| words.get(k)?.parse().ok().filter(|s: &f64| s.is_finite() && *s > 0.0);
            let sigma_m = accuracy(HORIZONTAL).zip(accuracy(HORIZONTAL + 1));
            positions.push(StatedPosition {
                name: views[place].name.clone(),
                pose: views[place].pose,
                position,
                sigma_m: sigma_m.map(|(horizontal, vertical)| DVec3::new(horizontal, horizontal, vertical)),
                up_in_camera: None,
            });
        }
    }
    Ok((epsg, positions))
}
