//! `satgs changes` through the binary: houses that were built and torn down between two surfaces, and wrong input.

use crate::common::{refused, succeeds};
use satgs::io::{Cog, Grid2, ImageFile, MapGrid, VerticalReference};
use serde_json::Value;
use std::path::Path;

const TOWN: &str = "data/town/truth/TOWN_DSM.tif";

fn town() -> (Grid2, MapGrid) {
    let file = ImageFile::open(Path::new(TOWN)).unwrap();
    (file.read(1).unwrap(), file.map_grid().unwrap())
}

fn write(path: &str, heights: &Grid2, grid: MapGrid) {
    let cog = Cog { grid, metadata: &[], heights_from: Some(&VerticalReference::Ellipsoid) };
    cog.write_f32(Path::new(path), &[("height", "m", heights)]).unwrap();
}

/// Raises a part of a surface.
fn build(heights: &mut Grid2, (west, north): (usize, usize), (width, height): (usize, usize), by_m: f32) {
    for row in north..north + height {
        heights.data[row * heights.width..][west..west + width].iter_mut().for_each(|z| *z += by_m);
    }
}

#[test]
fn a_house_that_was_built_and_one_that_was_torn_down_are_found_between_shifted_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (truth, grid) = town();
    let [mut earlier, mut later] = [truth.clone(), truth];
    build(&mut earlier, (20, 60), (20, 16), 5.0);
    build(&mut later, (90, 30), (24, 20), 6.0);
    later.data.iter_mut().for_each(|z| *z += 1.7);
    write(&path("a.tif"), &earlier, grid);
    // It lies 1.5 m farther east and 1 m farther south.
    write(&path("b.tif"), &later, MapGrid { west: grid.west + 1.5, north: grid.north - 1.0, ..grid });
    let words = ["changes", &path("a.tif"), &path("b.tif"), "-o", &path("found"), "--json"];
    let found: Value = serde_json::from_slice(&succeeds(&words).stdout).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let moved: Vec<f64> = found["moved_m"].as_array().unwrap().iter().map(number).collect();
    let expected = [-1.5, 1.0, -1.7];
    assert!(moved.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.1), "{moved:?}");
    let volumes: Vec<f64> =
        found["regions"].as_array().unwrap().iter().map(|r| number(&r["volume_m3"])).collect();
    // 24 x 20 and 20 x 16 cells of 0.25 m².
    assert_eq!(volumes.len(), 2, "{found}");
    assert!((volumes[0] - 720.0).abs() < 30.0 && (volumes[1] + 400.0).abs() < 20.0, "{volumes:?}");
    let map = ImageFile::open(&folder.path().join("found/difference.tif")).unwrap();
    assert_eq!(map.bands(), 2);
    assert!((map.read(1).unwrap().at(100, 40) - 6.0).abs() < 0.1);
    for file in ["difference.qml", "difference.png", "changes.gpkg", "changes.json"] {
        assert!(folder.path().join("found").join(file).exists(), "{file}");
    }
    refused(&words[..5], 2, &["difference.tif` exists", "--overwrite"]);
}

#[test]
fn surfaces_that_cannot_be_compared_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (truth, grid) = town();
    write(&path("far.tif"), &truth, MapGrid { west: grid.west + 5000.0, ..grid });
    let out = path("found");
    refused(&["changes", TOWN, &path("far.tif"), "-o", &out], 2, &["far.tif", "0 cells in common"]);
    refused(&["changes", TOWN, "data/town/VIEW_01.tif", "-o", &out], 2, &["VIEW_01.tif"]);
    refused(&["changes", TOWN, &path("none"), "-o", &out], 2, &["none"]);
    refused(&["changes", TOWN, TOWN, "-o", &out, "--least-area", "nan"], 2, &["--least-area"]);
    assert!(!Path::new(&out).exists());
}
