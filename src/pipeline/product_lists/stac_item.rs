//! The products of a run as a STAC Item, `RUN/item.json`, by which catalogues and QGIS find them: STAC 1.1
//! (<https://github.com/radiantearth/stac-spec>) with the projection extension 2.0.

use super::super::PipelineError;
use super::super::run_folder::perspective_manifest;
use super::super::run_folder::stage::hash_file;
use crate::frame::{Point, SiteGrid, Utm};
use crate::io::{HeightSystem, ImageFile, MapGrid, read_json, remove_if_there, write_json};
use crate::run_files::{
    ABOVE_GROUND, CONFIDENCE, DSM, GROUND, HILLSHADE, ITEM, MESHES, ORTHO, PAGE, SCENE, SPLATS,
};
use crate::scene::{Role, Scene};
use serde_json::{Map, Value, json};
use std::path::Path;

const STAC_VERSION: &str = "1.1.0";
const PROJECTION: &str = "https://stac-extensions.github.io/projection/v2.0.0/schema.json";
const COG: &str = "image/tiff; application=geotiff; profile=cloud-optimized";
/// Points along each side of the grid, of which the bounds in degrees are taken: sides of a map bend on the globe.
const ALONG_SIDE: usize = 8;
/// Decimals of degrees: 1 cm.
const DECIMALS: f64 = 1e7;

/// File, title, media type, roles of what an Item lists, if it is there.
const ASSETS: [(&str, &str, &str, &[&str]); 11] = [
    (DSM, "Surface model: heights of ground, roofs and trees", COG, &["data"]),
    (GROUND, "Bare ground", COG, &["data"]),
    (ABOVE_GROUND, "Heights of the surface model above the bare ground", COG, &["data"]),
    (ORTHO, "Orthophoto", COG, &["visual", "data"]),
    (CONFIDENCE, "Opacity, altitude spread, views and expected error of each cell", COG, &["metadata"]),
    (HILLSHADE, "Shaded relief", COG, &["visual"]),
    ("hillshade.png", "Shaded relief as a picture", "image/png", &["overview"]),
    (
        SPLATS,
        "Gaussian splats in the site frame; splats.georef.json says where it lies",
        "application/octet-stream",
        &["data"],
    ),
    (MESHES[0], "Mesh", "model/gltf-binary", &["data"]),
    (MESHES[1], "Mesh", "application/octet-stream", &["data"]),
    (PAGE, "Report", "text/html", &["metadata"]),
];

/// Writes `RUN/item.json` of the products that are there. There is none without a surface model, and none if no image of
/// the run has a date, which an Item must have; an Item of before is removed then.
pub(super) fn write_item(run: &Path) -> Result<(), PipelineError> {
    let path = run.join(ITEM);
    let dsm = run.join(DSM);
    let dates = dates(run)?;
    let (Some((start, end)), true) = (dates, dsm.exists()) else { return Ok(remove_if_there(&path)?) };
    let file = ImageFile::open(&dsm)?;
    let grid = file.map_grid()?;
    let (bbox, geometry) = place(&grid);
    let west_south_east_north = grid.bounds();
    let mut properties = json!({
        "title": "Surface model and orthophoto of satellite images",
        "datetime": if start == end { json!(start) } else { Value::Null },
        "start_datetime": start,
        "end_datetime": end,
        "gsd": grid.cell,
        "proj:code": format!("EPSG:{}", grid.epsg),
        "proj:shape": [grid.height, grid.width],
        "proj:transform": [grid.cell, 0.0, grid.west, 0.0, -grid.cell, grid.north],
        "proj:bbox": west_south_east_north,
    });
    if let (Some(above), Some(properties)) =
        (HeightSystem::of_raster(&file)?.from, properties.as_object_mut())
    {
        properties.insert("satgs:vertical_reference".into(), above.into());
    }
    let there = ASSETS.iter().filter(|asset| run.join(asset.0).exists());
    let assets: Map<String, Value> = there
        .map(|(file, title, media_type, roles)| {
            let key = file.replace('.', "_");
            let key = key.strip_suffix("_tif").unwrap_or(&key).to_owned();
            (key, json!({ "href": format!("./{file}"), "title": title, "type": media_type, "roles": roles }))
        })
        .collect();
    let item = json!({
        "type": "Feature",
        "stac_version": STAC_VERSION,
        "stac_extensions": [PROJECTION],
        // The same products have the same name in every folder.
        "id": format!("satgs-{}", hash_file(&dsm)),
        "geometry": geometry,
        "bbox": bbox,
        "properties": properties,
        "links": [],
        "assets": assets,
    });
    Ok(write_json(&path, &item)?)
}

/// Times of the first and the last image that was trained on, RFC 3339; none if not a single one is known.
fn dates(run: &Path) -> Result<Option<(String, String)>, PipelineError> {
    if perspective_manifest::is_run(run) || !run.join(SCENE).exists() {
        return Ok(None);
    }
    let made_by = "`satgs ba SCENE -o RUN --overwrite` makes it again";
    let scene: Scene =
        read_json(&run.join(SCENE)).map_err(|source| PipelineError::RunFile { source, made_by })?;
    let trained = scene.views.iter().filter(|view| view.role == Role::Train);
    let known: Vec<&str> = trained.filter_map(|view| view.acquired.as_deref()).collect();
    // Of a day without a time, the Item covers all hours.
    let at = |time: &str, hour: &str| match time.contains('T') {
        true => time.to_owned(),
        false => format!("{time}T{hour}Z"),
    };
    let first = known.iter().map(|time| at(time, "00:00:00")).min();
    let last = known.iter().map(|time| at(time, "23:59:59")).max();
    Ok(first.zip(last))
}

/// Bounding box in degrees of longitude and latitude of a grid (west, south, east, north), and its outline as GeoJSON. Of a grid
/// across the antimeridian, west is greater than east, and the outline is the box in two parts (RFC 7946, 3.1.9 and 5.2).
fn place(grid: &MapGrid) -> ([f64; 4], Value) {
    let frame = SiteGrid { epsg: grid.epsg, origin: Point::new(0.0, 0.0, 0.0) };
    let (w, s, e, n) = grid.bounds();
    // Counter-clockwise, as GeoJSON asks for.
    let corners = [(w, s), (e, s), (e, n), (w, n), (w, s)];
    let degrees = |(x, y): (f64, f64)| {
        let p = frame.geodetic_from_utm(Point::<Utm>::new(x, y, 0.0));
        [p.lon_deg(), p.lat_deg()].map(|v| (v * DECIMALS).round() / DECIMALS)
    };
    let between = |(a, b): (&(f64, f64), &(f64, f64)), i: usize| {
        let t = i as f64 / ALONG_SIDE as f64;
        (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t)
    };
    let sides = corners.iter().zip(&corners[1..]);
    let border: Vec<[f64; 2]> =
        sides.flat_map(|side| (0..ALONG_SIDE).map(move |i| degrees(between(side, i)))).collect();
    let lowest = |k: usize, from: f64| {
        border.iter().map(|p| p[k]).filter(|v| *v >= from).fold(f64::INFINITY, f64::min)
    };
    let highest = |k: usize, to: f64| {
        border.iter().map(|p| p[k]).filter(|v| *v <= to).fold(f64::NEG_INFINITY, f64::max)
    };
    let (south, north) = (lowest(1, -90.0), highest(1, 90.0));
    let (west, east) = (lowest(0, -180.0), highest(0, 180.0));
    if east - west <= 180.0 {
        let ring = corners.map(degrees);
        return ([west, south, east, north], json!({ "type": "Polygon", "coordinates": [ring] }));
    }
    let (west, east) = (lowest(0, 0.0), highest(0, 0.0));
    let part = |w: f64, e: f64| json!([[[w, south], [e, south], [e, north], [w, north], [w, south]]]);
    let parts = json!({ "type": "MultiPolygon", "coordinates": [part(west, 180.0), part(-180.0, east)] });
    ([west, south, east, north], parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outline_contains_the_grid_and_is_cut_at_the_antimeridian() {
        let grid =
            MapGrid { epsg: 32631, west: 700_000.0, north: 4_800_000.0, cell: 0.5, width: 400, height: 200 };
        let ([west, south, east, north], outline) = place(&grid);
        assert!(west < east && south < north && (5.0..6.0).contains(&west) && (43.0..44.0).contains(&south));
        let ring = outline["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (5, &ring[4]));
        // 200 m of longitude at this latitude.
        assert!((east - west - 0.00248).abs() < 1e-4, "{}", east - west);

        // Zone 1 begins at 180 degrees west, 333 km from its middle at the equator.
        let across =
            MapGrid { epsg: 32601, west: 160_000.0, north: 10_000.0, cell: 100.0, width: 200, height: 100 };
        let ([west, _, east, _], outline) = place(&across);
        assert!(west > 179.0 && east < -179.0, "{west} {east}");
        assert_eq!(outline["coordinates"].as_array().unwrap().len(), 2);
    }
}
