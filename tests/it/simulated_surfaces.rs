//! `satgs simulate --surface`, `--mountains` and `--view` through the binary.

use crate::common::{refused, succeeds};
use serde_json::Value;
use std::path::Path;

const TOWN: &str = "data/town/truth/TOWN_DSM.tif";

#[test]
fn satellites_are_put_over_a_surface_of_the_user() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("plan");
    let out = out.to_str().unwrap();
    let views = ["--view", "15,11,2024-06-15T10:45", "--view", "15,191,2024-06-15T10:46"];
    let done =
        succeeds(&[&["simulate", out, "--surface", TOWN, "--size", "80", "--json"][..], &views].concat());
    let json: Value = serde_json::from_slice(&done.stdout).unwrap();
    let surface = &json["summary"]["surface"];
    assert_eq!(
        (&surface["vertical"], &surface["vertical_is_assumed"]),
        (&"WGS 84 ellipsoid".into(), &false.into())
    );
    assert!(json["summary"]["views"][0]["sun_elevation_deg"].as_f64().unwrap() > 60.0);
    // The truth is the given surface.
    let truth = json["summary"]["truth"].as_str().unwrap();
    assert!(truth.ends_with("SURFACE_DSM.tif"));
    let read = |path: &Path| satgs::io::ImageFile::open(path).unwrap();
    let (made, given) = (read(Path::new(truth)), read(Path::new(TOWN)));
    let (grid, of) = (made.map_grid().unwrap(), given.map_grid().unwrap());
    let (made, given) = (made.read(1).unwrap(), given.read(1).unwrap());
    let shift = [(grid.west - of.west) / of.cell, (of.north - grid.north) / of.cell];
    let worst = (0..grid.width * grid.height)
        .map(|k| (k % grid.width, k / grid.width))
        .map(|(c, r)| (made.at(c, r) - given.bilinear(c as f64 + shift[0], r as f64 + shift[1])).abs())
        .fold(0.0f32, f32::max);
    assert!(worst < 0.01, "{worst}");
}

#[test]
fn what_cannot_be_simulated_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene");
    let with = |more: &[&str], says: &[&str]| {
        refused(&[&["simulate", out.to_str().unwrap()][..], more].concat(), 2, says)
    };
    with(&["--surface", "absent.tif"], &["absent.tif"]);
    with(&["--surface", TOWN, "--texture", "data/town/VIEW_01.tif"], &["VIEW_01.tif", "geotransform"]);
    with(&["--surface", TOWN, "--surface-vertical", "NAVD1"], &["`NAVD1` is not a known vertical reference"]);
    with(&["--surface", TOWN, "--mountains"], &["--mountains"]);
    with(&["--texture", TOWN], &["--surface"]);
    with(&["--mountains", "--view", "11"], &["two angles"]);
    with(&["--mountains", "--view", "11,11,tomorrow", "--view", "1,1"], &["`tomorrow` is no time"]);
    with(&["--mountains", "--view", "11,11"], &["2 to 99"]);
    with(&["--mountains", "--view", "60,11", "--view", "1,1"], &["0 to 45 degrees"]);
    with(&["--mountains", "--bits", "12"], &["8 or 16"]);
}

/// The error of the confirmed cells of a simulated mountain that two views see from these directions, metres, and what the
/// run says.
fn mountain_seen_from(views: [&str; 2]) -> (f64, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (scene, run) = (path("scene"), path("run"));
    let [a, b] = [format!("{},2024-08-20T10:30", views[0]), format!("{},2024-08-20T10:31", views[1])];
    succeeds(&[
        "simulate",
        &scene,
        "--mountains",
        "--seed",
        "5",
        "--size",
        "260",
        "--view",
        &a,
        "--view",
        &b,
    ]);
    let truth = std::fs::read_dir(Path::new(&scene).join("truth")).unwrap().map(|f| f.unwrap().path());
    let truth = truth.into_iter().find(|f| f.to_str().unwrap().ends_with("_DSM.tif")).unwrap();
    let done = succeeds(&["run", &scene, "-o", &run, "--no-splats", "--truth", truth.to_str().unwrap()]);
    let scores = std::fs::read(Path::new(&run).join("eval/metrics.json")).unwrap();
    let scores: Value = serde_json::from_slice(&scores).unwrap();
    let xyz = &scores["registered_scores"][2];
    (xyz["confirmed"]["mae_m"].as_f64().unwrap(), String::from_utf8(done.stderr).unwrap())
}

#[test]
fn a_pair_of_a_vertical_and_a_very_oblique_view_gives_a_surface() {
    let (mae_m, said) = mountain_seen_from(["0,11", "35,191"]);
    assert!(mae_m < 0.5, "{mae_m}");
    assert!(!said.contains("differ by"), "{said}");
}

#[test]
fn a_pair_of_a_very_small_or_large_angle_gives_a_surface_and_a_warning() {
    for (views, at_most_m) in [(["2,11", "2,191"], 1.0), (["30,11", "30,191"], 0.5)] {
        let (mae_m, said) = mountain_seen_from(views);
        assert!(mae_m < at_most_m, "{views:?}: {mae_m}");
        assert!(said.contains("heights are more exact"), "{said}");
    }
}
