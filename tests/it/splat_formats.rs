//! `satgs export` in the formats of viewers and globes, and `satgs info` of these files.

use crate::common::{photographs, refused, succeeds};
use crate::export::run;
use satgs::export::{Axes, SplatFile, splat_gltf};
use satgs::frame::{LevelFrame, Point, SiteGrid};
use satgs::pipeline::{TilesetPart, TrainedCameras, export_tileset};
use satgs::progress::NoProgress;
use satgs::splat::appearance::Appearance;
use satgs::splat::satellite::NovelView;
use satgs::splat::splats::Splats;
use serde_json::Value;
use std::path::Path;

/// PSNR of renders of compressed splats against those of the run, dB.
const LEAST_PSNR_DB: f64 = 40.0;
/// Distance of splats on the globe from where the map has them, metres.
const FARTHEST_M: f64 = 0.02;

/// Peak signal-to-noise ratio of pictures of the run's views, dB.
fn psnr(cameras: &TrainedCameras, expected: &Splats, found: &Splats) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for view in &cameras.setup.views {
        let view = NovelView { sun_shear: None, ..NovelView::from(view) };
        let picture =
            |splats: &Splats| view.picture(splats, &Appearance::default(), cameras.setup.altitudes).colors;
        for (a, b) in picture(expected).iter().zip(&picture(found)) {
            sum += a.data.iter().zip(&b.data).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            count += a.data.len();
        }
    }
    -10.0 * (sum / count as f64).log10()
}

#[test]
fn splats_of_every_format_look_like_those_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let run = run();
    let cameras = TrainedCameras::read(run).unwrap();
    let own = cameras.read_shown_splats(run).unwrap();
    for (option, name, more) in [
        ("--ply", "a.ply", vec![]),
        ("--ply", "b.ply", vec!["--variant", "y-down"]),
        ("--compressed-ply", "c.compressed.ply", vec![]),
        ("--compressed-ply", "d.compressed.ply", vec!["--variant", "y-down"]),
        ("--spz", "e.spz", vec![]),
        ("--gltf", "f.glb", vec![]),
        ("--gltf", "g.glb", vec!["--compress", "--copyright", "us"]),
    ] {
        let path = folder.path().join(name);
        let args = ["export", run.to_str().unwrap(), option, path.to_str().unwrap()];
        succeeds(&[&args[..], &more].concat());
        let read = SplatFile::read(&path).unwrap();
        assert_eq!((read.splats.len(), read.site), (own.len(), Some(cameras.setup.site)), "{name}");
        let db = psnr(&cameras, &own, &read.into_site());
        println!("{name}: {} bytes, {db:.1} dB", path.metadata().unwrap().len());
        assert!(db >= LEAST_PSNR_DB, "{name}: {db}");
        // What `satgs info` says.
        let info = succeeds(&["info", path.to_str().unwrap(), "--json"]);
        let info: Value = serde_json::from_slice(&info.stdout).unwrap();
        assert!(info["splats"] == own.len() && info["site"]["epsg"] == cameras.setup.site.epsg, "{info}");
        let text = succeeds(&["info", path.to_str().unwrap()]);
        let text = String::from_utf8_lossy(&text.stdout).into_owned();
        assert!(text.contains("degree 0") && text.contains("on EPSG:"), "{text}");
    }
}

/// The splats of a tile in the level frame of its tileset.
fn of_tile(path: &Path) -> Splats {
    Axes::EastUpSouth.to_site(splat_gltf::decode(&std::fs::read(path).unwrap()).unwrap().0)
}

/// Earth-centred coordinates of a position in the frame of a tileset's root.
fn ecef(tileset: &Value, p: [f32; 3]) -> [f64; 3] {
    let m: Vec<f64> = serde_json::from_value(tileset["root"]["transform"].clone()).unwrap();
    [0, 1, 2].map(|r| m[12 + r] + (0..3).map(|c| m[4 * c + r] * f64::from(p[c])).sum::<f64>())
}

fn far(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn on_earth(site: &SiteGrid, p: [f32; 3]) -> [f64; 3] {
    let [x, y, z] = p.map(f64::from);
    LevelFrame::ecef_from_geodetic(site.geodetic_from_site(Point::new(x, y, z))).xyz()
}

#[test]
fn splats_of_a_tileset_stand_where_the_map_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let tiles = folder.path().join("tiles");
    let run = run();
    let args = ["export", run.to_str().unwrap(), "--3dtiles", tiles.to_str().unwrap(), "--copyright", "us"];
    succeeds(&args);
    let cameras = TrainedCameras::read(run).unwrap();
    let own = cameras.read_shown_splats(run).unwrap();
    let document = tiles.join("tileset.json");
    let tileset: Value = serde_json::from_slice(&std::fs::read(&document).unwrap()).unwrap();
    let content = tileset["root"]["content"]["uri"].as_str().unwrap();
    let splats = of_tile(&tiles.join(content));
    assert_eq!(splats.len(), own.len());
    for i in (0..own.len()).step_by(own.len() / 10) {
        let expected = on_earth(&cameras.setup.site, own.position[i]);
        let found = ecef(&tileset, splats.position[i]);
        assert!(far(expected, found) < FARTHEST_M, "{expected:?} {found:?}");
    }
    let info = succeeds(&["info", document.to_str().unwrap()]);
    let info = String::from_utf8_lossy(&info.stdout).into_owned();
    assert!(info.contains("3D Tiles 1.1, 1 tiles in 1 levels") && info.contains("EPSG:4978"), "{info}");
    // The folder is not replaced unless asked for, and other files in it stay.
    refused(&args, 2, &["is not empty"]);
    std::fs::write(tiles.join("notes.txt"), "mine").unwrap();
    succeeds(&[&args[..], &["--overwrite"]].concat());
    assert!(tiles.join("notes.txt").exists());
}

#[test]
fn parts_of_a_scene_are_joined_under_one_root() {
    let folder = tempfile::tempdir().unwrap();
    let run = run();
    let cameras = TrainedCameras::read(run).unwrap();
    let own = cameras.read_shown_splats(run).unwrap();
    let [east, north, _] = cameras.setup.site.origin.xyz();
    let part = |name: &str, core| TilesetPart { run: run.into(), name: name.into(), core: Some(core) };
    let (w, e) = (east - 1e5, east + 1e5);
    let parts = [
        part("a-", [w, north - 1e5, east, north + 1e5]),
        part("b-", [east, north - 1e5, e, north + 1e5]),
        part("c-", [e, north, e + 10.0, north + 10.0]),
    ];
    let made = export_tileset(&parts, &folder.path().join("t"), None, false, &NoProgress).unwrap();
    assert_eq!((made.splats, made.tiles, made.levels), (own.len(), 3, 2));
    let tileset: Value = serde_json::from_slice(&std::fs::read(&made.tileset).unwrap()).unwrap();
    let root = &tileset["root"];
    assert!(root["refine"] == "REPLACE" && root["children"].as_array().unwrap().len() == 2, "{root}");
    assert!(root["geometricError"].as_f64().unwrap() > 0.0);
    let top = of_tile(&folder.path().join("t/tiles/root.glb"));
    assert!(top.len() < own.len() && !top.is_empty());
    let (west, east) = ("t/tiles/a-.glb", "t/tiles/b-.glb");
    let halves = [west, east].map(|name| of_tile(&folder.path().join(name)).len());
    assert!(halves[0] + halves[1] == own.len() && halves.iter().all(|n| *n > 0), "{halves:?}");
}

#[test]
fn photographs_without_a_place_on_earth_have_files_but_no_tiles() {
    let folder = tempfile::tempdir().unwrap();
    photographs::make_run(folder.path());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let said = refused(&["export", &path("run"), "--3dtiles", &path("tiles")], 2, &["has no georeference"]);
    assert!(said.contains("--georef") && !Path::new(&path("tiles")).exists(), "{said}");
    let own = satgs::splat::ply::read(&folder.path().join("run/splats.ply")).unwrap();
    for (option, name, within) in
        [("--spz", "a.spz", 0.01), ("--gltf", "a.glb", 1e-5), ("--compressed-ply", "a.compressed.ply", 0.02)]
    {
        succeeds(&["export", &path("run"), option, &path(name)]);
        let read = SplatFile::read(Path::new(&path(name))).unwrap();
        assert_eq!((read.site, read.info().degree), (None, 3));
        assert!(!folder.path().join("a.georef.json").exists());
        let read = read.into_site();
        // The compressed PLY has another order.
        if name.ends_with(".ply") {
            continue;
        }
        let rest = own.f_rest.as_flattened().iter().zip(read.f_rest.as_flattened());
        assert!(rest.clone().all(|(a, b)| (a - b).abs() < within), "{name}");
    }
}

#[test]
fn files_that_are_no_splats_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let run = run().to_str().unwrap();
    succeeds(&["export", run, "--spz", &path("whole.spz")]);
    let bytes = std::fs::read(path("whole.spz")).unwrap();
    std::fs::write(path("half.spz"), &bytes[..bytes.len() / 2]).unwrap();
    refused(&["info", &path("half.spz")], 2, &["half.spz", "cut off"]);
    std::fs::write(path("tileset.json"), r#"{"asset": {"version": "0.0"}, "root": {}}"#).unwrap();
    refused(&["info", &path("tileset.json")], 2, &["tileset.json", "version 0.0", "1.1"]);
    for (option, name, says) in [
        ("--spz", "x.ply", ".spz"),
        ("--gltf", "x.gltf", ".glb"),
        ("--compressed-ply", "x.sog", ".ply"),
        ("--spz", "whole.spz", "exists"),
    ] {
        refused(&["export", run, option, &path(name)], 2, &[says]);
    }
    // The georeference of one file never becomes that of another with other axes.
    refused(
        &["export", run, "--ply", &path("whole.ply"), "--overwrite"],
        2,
        &["whole.georef.json", "whole.spz"],
    );
    succeeds(&["export", run, "--gltf", &path("whole.glb")]);
    refused(&["export", run, "--spz", &path("y.spz"), "--compress"], 2, &["'--compress'"]);
}
