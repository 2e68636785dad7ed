//! A run's folder and what is made in it, through the binary: products added later, summaries told again, locks, outputs
//! that cannot be written.

#![cfg(unix)]

use crate::common::{copy_folder, refused, scenes, succeeds, text, two_views};
use gdal::raster::ColorInterpretation::{BlueBand, GrayIndex, GreenBand, RedBand};
use satgs::io::ImageFile;
use serde_json::Value;
use std::fs::File;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A small scene and its run.
struct Town {
    folder: tempfile::TempDir,
}

impl Town {
    fn new() -> Self {
        let town = Self { folder: tempfile::tempdir().unwrap() };
        copy_folder(scenes::town(), Path::new(&town.path("scene")));
        town
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn run(&self) -> String {
        self.path("run")
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.path().join("run").join(name)
    }

    /// What a command tells a machine, the first time and once it is done.
    fn tells_the_same_again(&self, args: &[&str]) -> Value {
        let told = || {
            let output = succeeds(&[args, &["--json"]].concat());
            serde_json::from_slice::<Value>(&output.stdout).unwrap()
        };
        let (first, again) = (told(), told());
        assert!(first.as_object().unwrap().len() > 2, "{first}");
        assert_eq!(first, again, "{args:?}");
        first
    }
}

/// A file that is written anew is another.
fn identity(path: &Path) -> u64 {
    path.metadata().unwrap().ino()
}

#[test]
fn a_run_folder_keeps_summaries_is_locked_and_accepts_later_products() {
    let town = Town::new();
    let (scene, run) = (town.path("scene"), town.run());
    let adjusted = town.tells_the_same_again(&["ba", &scene, "-o", &run]);
    assert!(adjusted["seconds"].as_f64().unwrap() > 0.0 && adjusted["tracks"].is_u64(), "{adjusted}");
    the_same_bytes_elsewhere(&town);
    stops_at_a_signal(&town);
    let train = ["train", &run, "--recipe", "baeogs", "--iterations", "60"];
    town.tells_the_same_again(&train);
    town.tells_the_same_again(&["dsm", &run]);
    products_are_added(&town);
    what_differs_is_named(&town);
    one_at_a_time(&town);
    places_that_cannot_be_written(&town);
    a_disk_that_is_full(&town);
}

/// Nothing in a product depends on the clock.
fn the_same_bytes_elsewhere(town: &Town) {
    // In a file no escapes, which only a terminal understands.
    let other = town.path("other");
    let output = succeeds(&["ba", &town.path("scene"), "-o", &other, "-vv"]);
    assert!(text(&output).contains("INFO") && !output.stderr.contains(&0x1b), "{}", text(&output));
    for name in ["ba/tie_points.gpkg", "ba/points.laz", "ba/points.ply", "scene.json"] {
        let bytes = |run: &str| std::fs::read(Path::new(run).join(name)).unwrap();
        assert!(bytes(&other) == bytes(&town.run()), "{name}");
    }
    let mut points = las::Reader::from_path(town.file("ba/points.laz")).unwrap();
    assert!(points.header().date().is_none());
    let all = points.read_all().unwrap();
    assert!(all.points().map(Result::unwrap).all(|p| (p.return_number, p.number_of_returns) == (1, 1)));
}

/// SIGTERM is what batch systems and containers send.
fn stops_at_a_signal(town: &Town) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_satgs"));
    let run = town.path("other");
    command.args(["train", &run, "--recipe", "baeogs", "--iterations", "30000", "--checkpoint-every", "5"]);
    let child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let checkpoint = Path::new(&run).join("train/checkpoint.bin");
    let start = Instant::now();
    while !checkpoint.exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no checkpoint appears");
        std::thread::sleep(Duration::from_millis(2));
    }
    refused(&["train", &run], 2, &["another satgs is at work in", "hint: wait"]);
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output));
    assert!(text(&output).contains("hint: the same command continues"), "{}", text(&output));
}

fn products_are_added(town: &Town) {
    let run = town.run();
    let (dsm, points, mesh) = (town.file("dsm.tif"), town.file("more/dsm.laz"), town.file("dsm.glb"));
    let before = identity(&dsm);
    let all = ["dsm", &run, "--points", "more/dsm.laz", "--mesh", "dsm.glb", "--hillshade", "--dtm"];
    succeeds(&all);
    assert_eq!(identity(&dsm), before, "the surface was there");
    assert!(std::fs::read(&mesh).unwrap().starts_with(b"glTF") && town.file("hillshade.tif").exists());
    for name in ["dtm.tif", "dtm.qml", "ndsm.tif", "ndsm.qml"] {
        assert!(town.file(name).exists(), "{name}");
    }
    let heights = |name: &str| ImageFile::open(&town.file(name)).unwrap().read(1).unwrap();
    let (top, bottom, above) = (heights("dsm.tif"), heights("dtm.tif"), heights("ndsm.tif"));
    let grid = |name: &str| ImageFile::open(&town.file(name)).unwrap().map_grid().unwrap();
    assert_eq!(grid("dtm.tif"), grid("dsm.tif"));
    assert_eq!(grid("ndsm.tif"), grid("dsm.tif"));
    for ((top, bottom), above) in top.data.iter().zip(&bottom.data).zip(&above.data) {
        assert_eq!(top.is_nan(), bottom.is_nan());
        assert!(top.is_nan() || top - bottom == *above);
    }
    let item: Value = serde_json::from_reader(File::open(town.file("item.json")).unwrap()).unwrap();
    assert_eq!((&item["type"], &item["stac_version"]), (&"Feature".into(), &"1.1.0".into()));
    let assets = item["assets"].as_object().unwrap();
    for key in ["dsm", "dtm", "ndsm", "ortho", "confidence", "hillshade", "splats_ply"] {
        let href = assets[key]["href"].as_str().unwrap();
        assert!(Path::new(&run).join(href).exists(), "{href}");
        assert!(assets[key]["type"].is_string() && assets[key]["roles"].is_array(), "{key}");
    }
    let properties = &item["properties"];
    let placed = grid("dsm.tif");
    assert_eq!(properties["proj:code"], format!("EPSG:{}", placed.epsg));
    assert_eq!(properties["proj:shape"], serde_json::json!([placed.height, placed.width]));
    let transform = [placed.cell, 0.0, placed.west, 0.0, -placed.cell, placed.north];
    assert_eq!(properties["proj:transform"], serde_json::json!(transform));
    assert!(properties["start_datetime"].as_str() < properties["end_datetime"].as_str());
    assert!(properties["datetime"].is_null());
    assert_eq!(properties["satgs:vertical_reference"], "ellipsoid");
    assert_eq!(item["bbox"].as_array().unwrap().len(), 4);
    assert_eq!(item["geometry"]["type"], "Polygon");
    let layers = std::fs::read_to_string(town.file("layers.qlr")).unwrap();
    let sources: Vec<&str> =
        layers.split("<datasource>").skip(1).map(|s| &s[..s.find('<').unwrap()]).collect();
    let (dsm, confidence) = ("./dsm.tif", "./confidence.tif");
    assert_eq!(sources, [confidence, confidence, "./ortho.tif", dsm, dsm, "./ndsm.tif", "./dtm.tif"]);
    assert_eq!(layers.matches("<pipe>").count(), sources.len(), "every layer has its drawing");
    let ground = identity(&town.file("dtm.tif"));
    let written = identity(&points);
    let again = succeeds(&all);
    assert!(text(&again).contains("has its surface already"), "{}", text(&again));
    assert_eq!(identity(&points), written, "it was there");
    std::fs::remove_file(town.file("ndsm.tif")).unwrap();
    succeeds(&all);
    assert!(town.file("ndsm.tif").exists(), "one of the two is missing: both are written");
    refused(
        &["dsm-eval", &town.path("run/ndsm.tif"), &town.path("run/dsm.tif")],
        2,
        &["height above ground"],
    );
    succeeds(&["dsm", &run, "--points", &town.path("elsewhere.laz")]);
    assert!(Path::new(&town.path("elsewhere.laz")).exists());
    refused(&["dsm", &run, "--points", "ba/points.laz"], 2, &["sparse points"]);

    let colors = |name: &str| {
        let raster = gdal::Dataset::open(town.file(name)).unwrap();
        let bands = 1..=raster.raster_count();
        bands.map(|i| raster.rasterband(i).unwrap().color_interpretation()).collect::<Vec<_>>()
    };
    assert_eq!(colors("ortho.tif"), [RedBand, GreenBand, BlueBand]);
    assert_eq!(colors("hillshade.tif"), [GrayIndex]);

    // Points of a surface that has been replaced are not the new one's.
    succeeds(&["dsm", &run, "--resolution", "1", "--overwrite"]);
    succeeds(&["dsm", &run, "--resolution", "1", "--points", "more/dsm.laz"]);
    assert_ne!(identity(&points), written);
    assert_ne!(identity(&town.file("dtm.tif")), ground, "the ground is that of the new surface");
}

fn what_differs_is_named(town: &Town) {
    let (scene, run) = (town.path("scene"), town.run());
    let cells = ["cells of 1 m from", "cells of 0.5 m from", "hint: `satgs dsm RUN --overwrite`"];
    refused(&["dsm", &run, "--resolution", "0.5"], 2, &cells);
    let iterations = "made with other options or input: --iterations was 60, is 61\n";
    refused(
        &["train", &run, "--recipe", "baeogs", "--iterations", "61"],
        2,
        &[iterations, "hint: `satgs train RUN --overwrite`"],
    );
    refused(
        &["ba", &scene, "-o", &run, "--bands", "1", "--height-range", "-10,90"],
        2,
        &["--bands was [1,2,3], is [1]", "--height-range was none, is -10,90", "another -o keeps both"],
    );
}

fn one_at_a_time(town: &Town) {
    let (scene, run) = (town.path("scene"), town.run());
    let lock = File::create(town.file(".lock")).unwrap();
    lock.lock().unwrap();
    let truth = town.path("scene/truth/TOWN_DSM.tif");
    for args in [
        &["run", &scene, "-o", &run][..],
        &["ba", &scene, "-o", &run],
        &["train", &run],
        &["dsm", &run],
        &["align", &run, "--to", &truth],
    ] {
        refused(args, 2, &["another satgs is at work in"]);
    }
    // The page shows how far a run is.
    succeeds(&["report", &run]);
    drop(lock);
    succeeds(&["dsm", &run, "--resolution", "1"]);
    assert!(!town.file(".lock").exists(), "nothing of a lock is left");
}

/// Where not even root can write.
fn places_that_cannot_be_written(town: &Town) {
    let (scene, run, file) = (town.path("scene"), town.run(), town.path("file"));
    std::fs::write(&file, "").unwrap();
    let inside = format!("{file}/run");
    let new = town.path("new");
    refused(&["ba", &scene, "-o", &inside], 1, &["writing", &inside]);
    refused(&["run", &scene, "-o", "/proc/run"], 1, &["writing `/proc/run"]);
    refused(&["run", &scene, "-o", &new, "--mesh", "/sys/dsm.glb"], 1, &["writing `/sys/dsm.glb`"]);
    assert!(!Path::new(&new).exists(), "it was told too late");
    refused(&["dsm", &run, "--resolution", "1", "--points", "/sys/dsm.las"], 1, &["/sys/dsm.las"]);
    refused(&["render", &run, "--view", "0,0", "-o", "/sys/a.png"], 1, &["/sys/a.png"]);
    let truth = town.path("scene/truth/TOWN_DSM.tif");
    let dsm = town.file("dsm.tif");
    refused(&["dsm-eval", dsm.to_str().unwrap(), &truth, "-o", &inside], 1, &["is not a folder"]);
    refused(&["info", &scene, "--footprints", "/dev/full", "--overwrite"], 1, &["not a regular file"]);
    refused(&["simulate", &inside], 1, &[&inside]);
}

/// Whatever does not fit, what was there stays.
fn a_disk_that_is_full(town: &Town) {
    let disk = town.path("disk");
    std::fs::create_dir(&disk).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=8m", "tmpfs", &disk]).output();
    if !mount.is_ok_and(|m| m.status.success()) {
        println!("skipped: no file system of a few megabytes can be mounted here");
        return;
    }
    let _unmounted = Unmount(disk.clone());
    let run = format!("{disk}/run");
    assert!(Command::new("cp").args(["-r", &town.run(), &run]).status().unwrap().success());
    let dsm = std::fs::read(Path::new(&run).join("dsm.tif")).unwrap();
    refused(
        &["dsm", &run, "--resolution", "0.02", "--overwrite"],
        75,
        &["No space left", "error: writing", "free space"],
    );
    assert!(std::fs::read(Path::new(&run).join("dsm.tif")).unwrap() == dsm, "the old surface is lost");
    let fill = vec![0; 16 << 20];
    let _ = std::fs::write(Path::new(&disk).join("fill"), fill);
    let train = ["train", &run, "--recipe", "baeogs", "--iterations", "30", "--overwrite"];
    refused(&train, 75, &["No space left", "the same command continues"]);
    assert!(Path::new(&run).join("splats.ply").exists());
}

struct Unmount(String);

impl Drop for Unmount {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

#[test]
fn lost_output_is_an_error_and_a_closed_pipe_is_not() {
    let scene = two_views();
    let scene = scene.path().to_str().unwrap();
    let into = |args: &[&str], out: Stdio| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_satgs"));
        command.args(args).stdout(out).stderr(Stdio::piped()).spawn().unwrap().wait_with_output().unwrap()
    };
    let full = || Stdio::from(File::options().write(true).open("/dev/full").unwrap());
    for args in [&["info", scene, "--json"][..], &["info", scene], &["train", "--print-recipe", "best"]] {
        let output = into(args, full());
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", text(&output));
        assert!(text(&output).contains("error: standard output could not be written: No space left"));
    }
    assert_eq!(into(&["--help"], full()).status.code(), Some(1));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let output = into(&["info", scene, "--json"], writer.into());
    assert!(output.status.success() && !text(&output).contains("error"), "{}", text(&output));
}
