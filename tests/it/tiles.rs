//! Scenes larger than one tile, through the binary: the mosaic, resuming, jobs one by one, and wrong input.

use crate::common::{satgs, text};
use satgs::io::ImageFile;
use satgs::random::CounterRng;
use satgs::tiles::{Done, Plan};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Number of kills in the short and in the long test.
const FEW_KILLS: u64 = 2;
const MANY_KILLS: u64 = 20;
/// Iterations of a training that lasts a second.
const FEW_ITERATIONS: &str = "30";
/// Products of a tiled run.
const PRODUCTS: [&str; 3] = ["dsm.tif", "ortho.tif", "confidence.tif"];

/// A small town of 2 x 2 tiles, in a folder of its own.
struct Town {
    folder: tempfile::TempDir,
}

impl Town {
    fn new() -> Self {
        let town = Self { folder: tempfile::tempdir().unwrap() };
        let made = satgs(&["simulate", &town.path("scene"), "--size", "230", "--views", "4", "-q"]);
        assert!(made.status.success(), "{}", text(&made));
        town
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().into()
    }

    /// Arguments that cut the town into 2 x 2 tiles.
    fn arguments(&self, command: &'static str, run: &str, iterations: &'static str) -> Vec<String> {
        let tiling = ["--core", "70", "--overlap", "12", "--iterations", iterations];
        let [scene, run] = ["scene", run].map(|name| self.path(name));
        let all = [command, &scene, "-o", &run].into_iter().chain(tiling);
        all.map(String::from).collect()
    }

    fn call(&self, command: &'static str, run: &str, more: &[&str]) -> Output {
        let arguments = self.arguments(command, run, FEW_ITERATIONS);
        let all: Vec<&str> = arguments.iter().map(String::as_str).chain(more.iter().copied()).collect();
        satgs(&all)
    }
}

fn assert_code(output: &Output, code: i32) {
    assert_eq!(output.status.code(), Some(code), "{}", text(output));
}

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// The bytes of all products of a run and of its tiles, by path.
fn products(run: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let of_run = PRODUCTS.map(PathBuf::from);
    let plan = Plan::read(run).unwrap();
    let of_tiles = plan.tiles.iter().flat_map(|tile| {
        let files = ["splats.ply", "cameras.json", "dsm.tif", "ortho.tif", "confidence.tif"];
        files.map(|name| Path::new("tiles").join(&tile.id).join(name))
    });
    of_run
        .into_iter()
        .chain(of_tiles)
        .map(|name| (name.clone(), std::fs::read(run.join(name)).unwrap()))
        .collect()
}

fn assert_same(run: &Path, expected: &BTreeMap<PathBuf, Vec<u8>>) {
    for (name, bytes) in products(run) {
        assert!(bytes == expected[&name], "{} differs", name.display());
    }
}

#[test]
fn a_scene_of_several_tiles_becomes_one_surface_and_survives_kills() {
    let town = Town::new();
    let truth = town.path("scene/truth/TOWN_DSM.tif");
    let started = Instant::now();
    let made = town.call("run", "whole", &["--truth", &truth, "--json"]);
    assert_code(&made, 0);
    let lasts = started.elapsed();
    let summary: Value = serde_json::from_slice(&made.stdout).unwrap();
    let run = PathBuf::from(town.path("whole"));
    let plan = Plan::read(&run).unwrap();
    assert_eq!(plan.tiles.len(), 4, "{}", plan.ids());
    let scores = summary["dsm-eval"]["registered_scores"].as_array().unwrap();
    let xyz = scores.iter().find(|score| score["method"] == "xyz").unwrap();
    // 1.2 m was seen after these few iterations.
    assert!(xyz["mae_m"].as_f64().unwrap() < 2.0 && xyz["completeness"].as_f64().unwrap() > 0.9, "{xyz}");

    the_products_cover_the_area_on_one_grid(&run, &plan);
    a_second_call_changes_nothing(&town, &run);
    let expected = products(&run);
    jobs_one_by_one_give_the_same_bytes(&town, &expected);
    killed(&town, lasts, &expected, FEW_KILLS);
    what_is_wrong_with_a_done_tile_is_found(&town, &run, &expected);
}

fn the_products_cover_the_area_on_one_grid(run: &Path, plan: &Plan) {
    for name in PRODUCTS {
        let file = ImageFile::open(&run.join(name)).unwrap();
        assert!(file.map_grid().unwrap().is_same(&plan.mosaic_grid(), 1e-6), "{name}");
    }
    let heights = ImageFile::open(&run.join("dsm.tif")).unwrap().read(1).unwrap();
    let seen = heights.valid().filter(|v| v.is_finite()).count();
    assert!(seen as f64 > 0.9 * heights.data.len() as f64, "{seen} of {} cells", heights.data.len());
    for name in ["seams.gpkg", "report.html"] {
        assert!(run.join(name).exists(), "{name}");
    }
    for tile in &plan.tiles {
        let done = Done::read(&run.join("tiles").join(&tile.id)).unwrap();
        assert_eq!(done.input_hash, tile.input_hash);
    }
}

fn a_second_call_changes_nothing(town: &Town, run: &Path) {
    let files =
        [PRODUCTS.as_slice(), &["tiles.json", "tiles/x000_y000/done.json", "tiles/x001_y001/splats.ply"]];
    let times = || {
        files.concat().iter().map(|f| run.join(f).metadata().unwrap().modified().unwrap()).collect::<Vec<_>>()
    };
    let before = times();
    assert_code(&town.call("run", "whole", &[]), 0);
    assert_eq!(times(), before);
}

/// The jobs of a cluster, one by one and in another order than `satgs run` has.
fn jobs_one_by_one_give_the_same_bytes(town: &Town, expected: &BTreeMap<PathBuf, Vec<u8>>) {
    let run = town.path("jobs");
    assert_code(&town.call("plan", "jobs", &[]), 0);
    let plan = Plan::read(Path::new(&run)).unwrap();
    let too_early = satgs(&["tile", "blend", &run, &plan.tiles[0].id]);
    assert_code(&too_early, 1);
    assert!(text(&too_early).contains("is not done"), "{}", text(&too_early));
    for index in [2, 0, 3, 1] {
        let made = satgs(&["tile", "run", &run, "--index", &index.to_string(), "--events", "--threads", "1"]);
        assert_code(&made, 0);
        let lines = String::from_utf8(made.stdout).unwrap();
        let events: Vec<Value> = lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert!(events.iter().any(|e| e["event"] == "started" && e["stage"] == "training"));
        assert_eq!(events[events.len() - 1]["event"], "summary", "{lines}");
    }
    let status = satgs(&["tile", "status", &run, "--json"]);
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!(status["done"], 4, "{status}");
    for tile in plan.tiles.iter().rev() {
        assert_code(&satgs(&["tile", "blend", &run, &tile.id]), 0);
    }
    assert_code(&satgs(&["mosaic", &run]), 0);
    assert_same(Path::new(&run), expected);
}

fn killed(town: &Town, lasts: Duration, expected: &BTreeMap<PathBuf, Vec<u8>>, kills: u64) {
    let mut draw = CounterRng::new(7, 0, 0, 0);
    let more = ["--checkpoint-every", "10", "-q"].map(String::from);
    let arguments = [town.arguments("run", "killed", FEW_ITERATIONS), more.to_vec()].concat();
    for _ in 0..kills {
        let mut child = Command::new(env!("CARGO_BIN_EXE_satgs"))
            .args(&arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(lasts.mul_f64(draw.uniform() * 2.0 / kills as f64));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert_code(&town.call("run", "killed", &[]), 0);
    assert_same(Path::new(&town.path("killed")), expected);
}

fn what_is_wrong_with_a_done_tile_is_found(town: &Town, run: &Path, expected: &BTreeMap<PathBuf, Vec<u8>>) {
    let tile = run.join("tiles/x000_y000");
    // done.json names files that are not there.
    std::fs::remove_file(tile.join("ortho.tif")).unwrap();
    let again = satgs(&["tile", "run", run.to_str().unwrap(), "x000_y000"]);
    assert_code(&again, 0);
    assert!(text(&again).contains("done.json"), "{}", text(&again));
    assert_same(run, expected);
    // A file is cut short.
    let splats = std::fs::read(tile.join("splats.ply")).unwrap();
    std::fs::write(tile.join("splats.ply"), &splats[..splats.len() / 2]).unwrap();
    assert_code(&satgs(&["tile", "run", run.to_str().unwrap(), "x000_y000"]), 0);
    assert_same(run, expected);
    // done.json is of another plan.
    let mut done = json(&tile.join("done.json"));
    done["input_hash"] = "0123456789abcdef".into();
    std::fs::write(tile.join("done.json"), done.to_string()).unwrap();
    let status = satgs(&["tile", "status", run.to_str().unwrap(), "--json"]);
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!((&status["done"], &status["planned"]), (&3.into(), &1.into()), "{status}");
    assert_code(&town.call("run", "whole", &[]), 0);
    assert_same(run, expected);
}

#[test]
#[ignore = "twenty kills take minutes"]
fn twenty_kills_do_not_change_a_byte() {
    let town = Town::new();
    let started = Instant::now();
    assert_code(&town.call("run", "whole", &[]), 0);
    let lasts = started.elapsed();
    let expected = products(Path::new(&town.path("whole")));
    killed(&town, lasts, &expected, MANY_KILLS);
}

#[test]
fn wrong_plans_and_areas_are_refused_and_nothing_is_lost() {
    let town = Town::new();
    let run = town.path("run");
    let elsewhere = town.call("plan", "run", &["--aoi", "7.0,43.2,7.01,43.21"]);
    assert_code(&elsewhere, 2);
    assert!(text(&elsewhere).contains("area"), "{}", text(&elsewhere));
    for [option, value, expected] in [
        ["--core", "20", "at least twice the overlap"],
        ["--overlap", "0.6", "at least four cells"],
        ["--max-memory", "20MB", "--max-memory"],
        ["--max-memory", "3", "unit"],
    ] {
        let arguments = ["plan", &town.path("scene"), "-o", &run, "--iterations", "60", option, value];
        let refused = satgs(&arguments);
        assert_code(&refused, 2);
        assert!(text(&refused).contains(expected), "{option}: {}", text(&refused));
    }
    assert_code(&town.call("plan", "run", &[]), 0);
    let before = std::fs::read(Path::new(&run).join("tiles.json")).unwrap();
    let other = town.call("plan", "run", &["--seed", "1"]);
    assert_code(&other, 2);
    assert!(text(&other).contains("--seed was 0, is 1"), "{}", text(&other));
    assert_eq!(std::fs::read(Path::new(&run).join("tiles.json")).unwrap(), before);

    let unknown = satgs(&["tile", "run", &run, "x009_y009"]);
    assert_code(&unknown, 2);
    assert!(text(&unknown).contains("tile status"), "{}", text(&unknown));
    let beyond = satgs(&["tile", "run", &run, "--index", "4"]);
    assert_code(&beyond, 2);
    let early = satgs(&["mosaic", &run]);
    assert_code(&early, 1);

    // A window of the plan that was edited to lie outside of its image fails alone.
    let path = Path::new(&run).join("tiles.json");
    let mut plan = json(&path);
    plan["tiles"][3]["views"][0]["window"] = serde_json::json!([100_000, 0, 50, 50]);
    std::fs::write(&path, plan.to_string()).unwrap();
    let id = plan["tiles"][3]["id"].as_str().unwrap().to_owned();
    let broken = satgs(&["tile", "run", &run, &id]);
    assert_code(&broken, 2);
    assert!(text(&broken).contains("window of view"), "{}", text(&broken));
    let status = satgs(&["tile", "status", &run, "--json"]);
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!(status["failed"], 1, "{status}");
    assert!(status["tiles"][3]["reason"].as_str().unwrap().contains("window"), "{status}");

    // A tile whose prediction is beyond this machine is for another one.
    plan["tiles"][2]["cost"]["memory_mb"] = 1e9.into();
    std::fs::write(&path, plan.to_string()).unwrap();
    let huge = satgs(&["tile", "run", &run, "--index", "2"]);
    assert_code(&huge, 75);
    assert!(text(&huge).contains("MB of memory"), "{}", text(&huge));

    // The run is adjusted anew after it was planned.
    let stage = Path::new(&run).join("ba/stage.json");
    let mut record = json(&stage);
    record["made_from"]["--model"] = "affine".into();
    std::fs::write(&stage, record.to_string()).unwrap();
    let other = satgs(&["tile", "run", &run, "x000_y000"]);
    assert_code(&other, 2);
    assert!(text(&other).contains("another adjustment"), "{}", text(&other));
}

#[test]
fn two_jobs_on_one_tile_do_not_meet_and_none_outlives_its_parent() {
    let town = Town::new();
    let run = town.path("run");
    let long = town.arguments("plan", "run", "4000");
    assert_code(&satgs(&long.iter().map(String::as_str).collect::<Vec<_>>()), 0);
    let mut first = Command::new(env!("CARGO_BIN_EXE_satgs"))
        .args([
            "tile",
            "run",
            &run,
            "x000_y000",
            "--exit-with-parent",
            "--checkpoint-every",
            "20",
            "--events",
        ])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let checkpoint = Path::new(&run).join("tiles/x000_y000/train/checkpoint.bin");
    let started = Instant::now();
    while !checkpoint.exists() {
        assert!(started.elapsed() < Duration::from_secs(120), "no checkpoint appears");
        std::thread::sleep(Duration::from_millis(10));
    }
    let second = satgs(&["tile", "run", &run, "x000_y000"]);
    assert_code(&second, 1);
    assert!(text(&second).contains("at work"), "{}", text(&second));
    let status = satgs(&["tile", "status", &run, "--json"]);
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    assert_eq!(status["running"], 1, "{status}");

    drop(first.stdin.take());
    let stopping = Instant::now();
    let code = first.wait().unwrap().code();
    assert_eq!(code, Some(130));
    assert!(stopping.elapsed() < Duration::from_secs(40));
    assert!(checkpoint.exists(), "an interrupted job leaves its checkpoint");
}
