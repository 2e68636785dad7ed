//! Depths of photographs by matching, through the binary.

use crate::common::{files, refused, succeeds};
use satgs::perspective::colmap;
use std::path::Path;

/// A room of a few small images, and paths in a folder.
fn with_room(test: impl Fn(&Path, &dyn Fn(&str) -> String)) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    succeeds(&["simulate", &path("room"), "--room", "--views", "12", "--size", "64", "-q"]);
    test(folder.path(), &path);
}

#[test]
fn stereo_makes_maps_in_the_unit_of_the_scene_once() {
    with_room(|folder, path| {
        let args = ["prior", &path("room"), "-o", &path("maps"), "--stereo", "-q"];
        succeeds(&args);
        let made = files(&folder.join("maps"));
        let kind = String::from_utf8_lossy(&made[&folder.join("maps/prior.json")]);
        assert!(kind.contains("measured"), "{kind}");
        let maps = made.keys().filter(|name| name.extension().is_some_and(|end| end == "npy")).count();
        // Two of twelve views are held back.
        assert!((1..=10).contains(&maps), "{maps}");
        succeeds(&args);
        assert_eq!(files(&folder.join("maps")), made);
        refused(&[&args[..], &["--normals"]].concat(), 2, &["--normals", "depths"]);
    });
}

#[test]
fn a_scene_without_points_starts_from_its_photographs() {
    with_room(|folder, path| {
        let points = folder.join("room/sparse/0");
        let mut without = colmap::read(&points).unwrap();
        without.points.clear();
        without.images.iter_mut().for_each(|image| image.observations.clear());
        std::fs::remove_dir_all(&points).unwrap();
        colmap::write(&points, &without, colmap::Format::Binary).unwrap();
        succeeds(&["run", &path("room"), "-o", &path("run"), "--iterations", "2", "-q"]);
        assert!(folder.join("run/priors/stereo/prior.json").is_file());
        let summary = std::fs::read_to_string(folder.join("run/train/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        // Random points are 100,000; the images have fewer pixels.
        assert!((1000..40_000).contains(&summary["splats_start"].as_u64().unwrap()), "{summary}");
    });
}
