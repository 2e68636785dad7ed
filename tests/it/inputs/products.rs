//! What a run writes, prints and keeps.

use super::input;
use crate::common::perspective::{phone, project};
use crate::common::{copy_folder, files, refused, succeeds, text};
use satgs::frame::{Point, SiteGrid};
use satgs::io::{Grid2, ImageFile, SensorImage};
use satgs::perspective::colmap::Format;
use satgs::rpc::Rpc;
use satgs::tiles::{Plan, TileCost};
use serde_json::Value;
use std::path::{Path, PathBuf};

pub const FOLDERS: &[&str] =
    &["nodata_counts_as_seen", "plan_resolution_memory", "tiles_partly_covered", "zone_border"];

/// The example scene and its truth.
const TOWN: &str = "data/town";
const TRUTH: &str = "data/town/truth/TOWN_DSM.tif";

/// A folder for runs.
struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }
}

/// What a command prints with `--json`.
fn told(args: &[&str]) -> Value {
    serde_json::from_slice(&succeeds(&[args, &["--json"]].concat()).stdout).unwrap()
}

fn band(path: &Path, index: usize) -> Grid2 {
    ImageFile::open(path).unwrap().read(index).unwrap()
}

/// Arguments of a command.
fn joined<'a>(first: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [first, more].concat()
}

/// What the command printed on standard output.
fn shown(args: &[&str]) -> String {
    String::from_utf8_lossy(&succeeds(args).stdout).into_owned()
}

#[test]
fn heights_confirmed_and_filled_are_kept_apart_everywhere() {
    let place = Place::new();
    let run = place.path("run");
    let all = ["run", TOWN, "-o", &run, "--truth", TRUTH, "--iterations", "5"];
    let said = shown(&all);
    for words in ["% of the cells have a height", "% confirmed by two views or more", "% filled in"] {
        assert!(said.contains(words), "{said}");
    }
    let (confirmed, filled) = ("confirmed, xyz", "filled, xyz");
    assert!(said.contains(confirmed) && said.contains(filled), "{said}");
    let page = std::fs::read_to_string(place.file("run/report.html")).unwrap();
    for words in ["confirmed by two views or more", confirmed, filled] {
        assert!(page.contains(words), "{words}");
    }

    // The summary agrees with the rasters.
    let summary = told(&all);
    let count = |key: &str| summary["dsm"]["cells"][key].as_u64().unwrap();
    let (heights, views) = (band(&place.file("run/dsm.tif"), 1), band(&place.file("run/confidence.tif"), 3));
    let cells = |is: &dyn Fn(f32, f32) -> bool| {
        heights.data.iter().zip(&views.data).filter(|(z, views)| is(**z, **views)).count() as u64
    };
    assert_eq!(count("all"), heights.data.len() as u64);
    assert_eq!(count("with_height"), cells(&|z, _| !z.is_nan()));
    assert_eq!(count("confirmed"), cells(&|z, views| !z.is_nan() && views >= 2.0));
    assert_eq!(count("with_height"), count("confirmed") + count("filled"));
    assert!(count("filled") > 0 && count("filled") < count("confirmed"));

    // So do the scores: filled cells are worse, and completeness is that of what was measured.
    let scores = &summary["dsm-eval"]["registered_scores"][2];
    let score = |of: &str, key: &str| scores[of][key].as_f64().unwrap();
    assert!(score("filled", "mae_m") > 1.5 * score("confirmed", "mae_m"), "{scores}");
    let sum = score("confirmed", "completeness") + score("filled", "completeness");
    assert!((sum - scores["completeness"].as_f64().unwrap()).abs() < 1e-9, "{scores}");
    assert!(score("confirmed", "completeness") < 0.9, "{scores}");

    needles_are_not_confirmed(&place);
    without_fills(&place, &run, &heights, &views, &summary["dsm-eval"]["registered_scores"][0]);
}

/// On the lake, which has no texture, views agree on heights of up to 24.6 m above the water: single cells, whose neighbours
/// deny them.
fn needles_are_not_confirmed(place: &Place) {
    let classes = ImageFile::open(Path::new("data/town/truth/TOWN_CLS.tif")).unwrap();
    let (map, classes) = (classes.map_grid().unwrap(), classes.read(1).unwrap());
    let dsm = ImageFile::open(&place.file("run/dsm.tif")).unwrap();
    let (grid, heights) = (dsm.map_grid().unwrap(), dsm.read(1).unwrap());
    let views = band(&place.file("run/confidence.tif"), 3);
    // Farther from the shore than the surface is from its true place.
    let is_water = |col: i64, row: i64| {
        let around = (-5..=5).flat_map(|r| (-5..=5).map(move |c| (col + c, row + r)));
        around.into_iter().all(|(c, r)| (classes.get(c, r) - 9.0).abs() < 0.5)
    };
    let cells = (0..grid.height).flat_map(|row| (0..grid.width).map(move |col| (col, row)));
    let of_lake = cells.filter(|(col, row)| {
        let px = map.corner_px_from_utm(grid.cell_center(*col, *row));
        !heights.at(*col, *row).is_nan() && is_water(px.col.floor() as i64, px.row.floor() as i64)
    });
    let lake: Vec<(f32, f32)> = of_lake.map(|(c, r)| (heights.at(c, r), views.at(c, r))).collect();
    let mut levels: Vec<f32> = lake.iter().map(|cell| cell.0).collect();
    levels.sort_by(f32::total_cmp);
    let level = levels[levels.len() / 2];
    let confirmed = lake.iter().filter(|cell| cell.1 >= 2.0).count();
    let needles = lake.iter().filter(|cell| cell.1 >= 2.0 && (cell.0 - level).abs() > 3.0).count();
    assert!(lake.len() > 500 && confirmed > 25, "{confirmed} of {}", lake.len());
    assert_eq!(needles, 0, "of {confirmed} confirmed cells of water");
}

fn without_fills(place: &Place, run: &str, heights: &Grid2, views: &Grid2, before: &Value) {
    refused(&["dsm", run, "--no-fill", "--fill", "3"], 2, &["--no-fill"]);
    refused(&["dsm", run, "--no-fill"], 2, &["--no-fill was none, is given"]);
    let made = told(&["dsm", run, "--no-fill", "--overwrite"]);
    assert_eq!(
        (&made["cells"]["filled"], &made["cells"]["with_height"]),
        (&0.into(), &made["cells"]["confirmed"])
    );
    let kept = band(&place.file("run/dsm.tif"), 1);
    for ((kept, z), views) in kept.data.iter().zip(&heights.data).zip(&views.data) {
        assert!(if *views >= 2.0 { kept == z || kept.is_nan() && z.is_nan() } else { kept.is_nan() });
    }
    // A surface of confirmed cells alone has their scores: those of a registration in height of its own, which is nearly the same.
    let again = told(&["dsm-eval", &place.path("run/dsm.tif"), TRUTH]);
    let (all, confirmed) = (&again["registered_scores"][0], &before["confirmed"]);
    let near = |key: &str, slack: f64| {
        let (a, b) = (all[key].as_f64().unwrap(), confirmed[key].as_f64().unwrap());
        assert!((a - b).abs() < slack, "{key}: {a} {b}");
    };
    near("completeness", 0.02);
    near("mae_m", 0.1);
    assert_eq!(all["confirmed"]["cells"], all["cells"]);
    // A file of other cells is refused if it is named, and passed over if it only lies there.
    let other = place.path("run/train/first_surface.tif");
    let dsm = place.path("run/dsm.tif");
    refused(&["dsm-eval", &dsm, TRUTH, "--confidence", TRUTH], 2, &["is not the confidence of"]);
    assert!(Path::new(&other).exists());
    std::fs::copy(TRUTH, place.file("run/confidence.tif")).unwrap();
    assert!(told(&["dsm-eval", &dsm, TRUTH])["registered_scores"][2]["confirmed"].is_null());
}

#[test]
fn what_depends_on_a_surface_is_made_anew_or_removed() {
    let place = Place::new();
    let run = place.path("run");
    let products = ["--points", "surface.laz", "--mesh", "surface.glb", "--hillshade"];
    let all = ["run", TOWN, "-o", &run, "--truth", TRUTH, "--iterations", "5", "-q"];
    succeeds(&joined(&all, &products));
    succeeds(&["mesh", &run, "-o", &place.path("run/mesh.ply"), "-q"]);
    let points_m = || {
        let mut reader = las::Reader::from_path(place.file("run/surface.laz")).unwrap();
        let all = reader.read_all().unwrap();
        let z: Vec<f64> = all.points().map(|p| p.unwrap().z).collect();
        z.iter().sum::<f64>() / z.len() as f64
    };
    let dsm_m = || {
        let heights = band(&place.file("run/dsm.tif"), 1);
        let n = heights.valid().count() as f64;
        heights.valid().map(f64::from).sum::<f64>() / n
    };
    let before_m = points_m();
    let identity = |name: &str| std::fs::read(place.file(name)).unwrap();
    let (mesh, shade) = (identity("run/surface.glb"), identity("run/hillshade.tif"));
    std::fs::write(place.file("run/eval/mine.txt"), "kept").unwrap();

    // The points are 49 m away from a surface above the geoid: they are written again.
    let made = succeeds(&["dsm", &run, "--vertical", "EGM96", "--overwrite"]);
    assert!((points_m() - before_m).abs() > 40.0 && (points_m() - dsm_m()).abs() < 0.01);
    assert!(identity("run/surface.glb") != mesh && identity("run/hillshade.tif") == shade);
    for words in [
        "surface.laz` is written",
        "surface.glb` is written",
        "are of the surface model before and are removed",
    ] {
        assert!(text(&made).contains(words), "{words} in {}", text(&made));
    }
    // The scores are of the surface before, and so the page shows none.
    for name in ["metrics.json", "error.tif", "error.png", "histogram.svg"] {
        assert!(!place.file("run/eval").join(name).exists(), "{name}");
    }
    assert!(place.file("run/eval/mine.txt").exists());
    let page = || std::fs::read_to_string(place.file("run/report.html")).unwrap();
    assert!(!page().contains("Registrations") && page().contains("confirmed by two views"));

    // A move takes with it what it can, and removes what shows the old place.
    succeeds(&["dsm-eval", &place.path("run/dsm.tif"), TRUTH, "-o", &place.path("run/eval"), "-q"]);
    succeeds(&["report", &run, "-q"]);
    assert!(page().contains("Registrations"));
    let moved = succeeds(&["align", &run, "--to", TRUTH]);
    for name in ["surface.laz", "surface.glb", "mesh.ply", "eval/metrics.json", "eval/error.tif"] {
        assert!(!place.file("run").join(name).exists(), "{name}");
    }
    assert!(
        text(&moved).contains("`surface.laz`") && text(&moved).contains("`mesh.ply`"),
        "{}",
        text(&moved)
    );
    assert!(!page().contains("Registrations"));

    // Another training: the surface of the one before stays, and it is said where it is shown.
    succeeds(&["dsm", &run, "-q"]);
    succeeds(&["mesh", &run, "-o", &place.path("run/mesh.ply"), "-q"]);
    let trained = succeeds(&["train", &run, "--iterations", "6", "--overwrite"]);
    let outdated = "are of another training than `splats.ply`";
    assert!(text(&trained).contains(outdated) && !place.file("run/mesh.ply").exists(), "{}", text(&trained));
    assert!(page().contains(outdated));
    refused(&["dsm", &run], 2, &["splats has changed"]);
    succeeds(&["dsm", &run, "--overwrite", "-q"]);
    assert!(!page().contains(outdated));

    // Another adjustment: the training stays, and it is said.
    let adjusted = succeeds(&["ba", TOWN, "-o", &run, "--model", "affine", "--overwrite"]);
    let outdated = "are of another adjustment than `ba` holds";
    assert!(text(&adjusted).contains(outdated) && page().contains(outdated), "{}", text(&adjusted));
}

#[test]
fn commands_for_one_area_name_a_tile_and_change_none() {
    let place = Place::new();
    let run = place.path("run");
    let tiling = ["--core", "50", "--overlap", "10", "--iterations", "5"];
    let all = joined(&["run", TOWN, "-o", &run], &tiling);
    let made = told(&all);
    let cells = &made["mosaic"]["cells"];
    let count = |key: &str| cells[key].as_u64().unwrap();
    assert_eq!(count("with_height"), count("confirmed") + count("filled"), "{cells}");
    assert!(count("filled") > 0 && count("all") > count("with_height"), "{cells}");
    let before = files(&place.file("run"));
    let tile = Plan::read(&place.file("run")).unwrap().tiles[0].id.clone();
    let (folder, picture) = (place.path(&format!("run/tiles/{tile}")), place.path("picture.png"));
    let (mesh, page) = (place.path("mesh.ply"), place.path("page.html"));
    for command in [
        &["train", &run, "--overwrite"] as &[&str],
        &["dsm", &run],
        &["dsm", &run, "--overwrite"],
        &["render", &run, "--view", "0,0", "-o", &picture],
        &["mesh", &run, "-o", &mesh],
        &["nvs-eval", &run],
        &["view", &run, "--html", &page],
        &["export", &run, "--ply", &mesh],
    ] {
        refused(
            command,
            2,
            &["is planned as several tiles", &format!("tiles/{tile}` is the folder of one tile")],
        );
    }
    for command in [
        &["train", &folder] as &[&str],
        &["train", &folder, "--overwrite"],
        &["dsm", &folder, "--overwrite"],
        &["ba", TOWN, "-o", &folder, "--overwrite"],
    ] {
        refused(command, 2, &["is a tile of", "hint: `satgs plan"]);
    }
    for folder in [&run, &folder] {
        refused(&["align", folder, "--to", TRUTH], 2, &["several tiles, which `satgs align` does not move"]);
    }
    assert!(files(&place.file("run")) == before, "nothing has changed");
    let own = format!("{folder}/dsm.tif");
    succeeds(&["dsm", &folder, "--like", &own, "--points", "cells.laz", "-q"]);
    assert!(Path::new(&folder).join("cells.laz").exists());
    let again = succeeds(&all);
    assert!(text(&again).contains("has its mosaic already"), "{}", text(&again));

    // A plan does not replace an area that was trained as a whole.
    let whole = place.path("whole");
    succeeds(&["run", TOWN, "-o", &whole, "--iterations", "5", "-q"]);
    let plan = joined(&["plan", TOWN, "-o", &whole], &tiling);
    refused(&plan, 2, &["holds a training of the whole area"]);
}

#[test]
fn tiles_have_every_option_of_training_and_surface() {
    let place = Place::new();
    let (run, network) = (place.path("run"), place.path("network"));
    std::fs::write(&network, "weights").unwrap();
    let more = ["--core", "50", "--overlap", "10", "--recipe", "satgs", "--iterations", "5"];
    let networks = ["--features", &network, "--lpips", &network, "--snapshots", "2", "--no-fill"];
    let plan = joined(&joined(&["plan", TOWN, "-o", &run], &more), &networks);
    succeeds(&plan);
    let planned = Plan::read(&place.file("run")).unwrap();
    let (train, surface) = (&planned.train, &planned.surface);
    let path = std::fs::canonicalize(&network).unwrap();
    assert_eq!(
        [&train.features, &train.lpips].map(|file| file.as_ref().map(|f| f.path.clone())),
        [Some(path.clone()), Some(path)]
    );
    assert!(train.snapshots == 2 && surface.no_fill && !train.predict);
    refused(&joined(&plan, &["--seed", "1"]), 2, &["--seed was 0, is 1"]);
    refused(&joined(&plan, &["--overwrite", "--resume"]), 2, &["--resume is for areas of one tile"]);
    // The jobs read the files that were planned with, or none.
    std::fs::write(&network, "other weights").unwrap();
    refused(&["tile", "run", &run, "--index", "0"], 2, &["network` is missing or another file"]);
}

#[test]
fn photographs_refuse_what_only_satellites_use() {
    let place = Place::new();
    project(&place.file("photos"), &phone(), Format::Text);
    let (scene, run) = (place.path("photos"), place.path("run"));
    for option in [
        ["--core", "100"],
        ["--overlap", "8"],
        ["--max-memory", "1GB"],
        ["--model", "affine"],
        ["--model", "shift"],
        ["--gamma", "auto"],
        ["--truth", "truth.tif"],
    ] {
        let given = joined(&["run", &scene, "-o", &run], &option);
        refused(&given, 2, &[&format!("{} is for satellite scenes", option[0])]);
    }
    refused(&["run", &scene, "-o", &run, "--no-fill"], 2, &["--no-fill is for satellite scenes"]);
    // Without a place on Earth there is no surface model.
    for option in [["--points", "points.laz"], ["--resolution", "1"], ["--vertical", "EGM96"]] {
        let given = joined(&["run", &scene, "-o", &run], &option);
        refused(&given, 2, &[option[0], "--georef"]);
    }
    refused(
        &["run", TOWN, "-o", &run, "--downsampling", "2"],
        2,
        &["--downsampling is for perspective scenes"],
    );
}

/// The RPCs of the views of a folder.
fn cameras(scene: &Path) -> Vec<Rpc> {
    let views = ["V01.tif", "V02.tif", "V03.tif", "V04.tif"].map(|name| scene.join(name));
    let read = |path: &PathBuf| satgs::scene::read_camera(path, false).unwrap().rpc;
    views.iter().map(read).collect()
}

#[test]
fn ground_that_views_see_is_in_a_tile_that_these_views_train() {
    let Some(input) = input("tiles_partly_covered") else { return };
    let (place, scene) = (Place::new(), input.join("scene"));
    let run = place.path("run");
    let aoi = "5.4988,43.2992,5.5012,43.3008";
    let tiling = ["--core", "40", "--overlap", "8", "--iterations", "5", "--aoi", aoi];
    let planned = succeeds(&joined(&["plan", scene.to_str().unwrap(), "-o", &run], &tiling));
    let plan = Plan::read(&place.file("run")).unwrap();
    let grid = plan.mosaic_grid();
    let map = SiteGrid { epsg: plan.epsg, origin: Point::new(0.0, 0.0, 0.0) };
    let rpcs = cameras(&scene);
    let size = ImageFile::open(&scene.join("V01.tif")).unwrap().size();
    let sees = |rpc: &Rpc, ground| {
        let px = rpc.project(ground);
        // Away from the border by more than the adjustment moves a view.
        let inside = |v: f64, n: usize| v >= 8.0 && v <= n as f64 - 9.0;
        inside(px.col, size.0) && inside(px.row, size.1)
    };
    let (mut seen, mut lost) = (0, 0);
    for (col, row) in
        (0..grid.height).step_by(4).flat_map(|r| (0..grid.width).step_by(4).map(move |c| (c, r)))
    {
        let p = grid.cell_center(col, row);
        let tile = plan.tiles.iter().find(|t| {
            let [w, s, e, n] = t.core;
            (w..e).contains(&p.x()) && (s..n).contains(&p.y())
        });
        let height_m = plan.origin_height_m;
        let ground = map.geodetic_from_utm(Point::new(p.x(), p.y(), height_m));
        let views: Vec<usize> = (0..rpcs.len()).filter(|i| sees(&rpcs[*i], ground)).collect();
        if views.len() >= 3 {
            seen += 1;
            let names = tile.map_or(Vec::new(), |t| t.views.iter().map(|v| v.name.clone()).collect());
            let trained = views.iter().filter(|i| names.contains(&format!("V0{}", **i + 1))).count();
            lost += usize::from(trained < 2);
        }
    }
    assert!(seen > 500, "{seen}");
    assert_eq!(lost, 0, "of {seen} places: {}", text(&planned));
}

#[test]
fn predictions_grow_with_the_cells_of_the_surface() {
    let place = Place::new();
    succeeds(&["ba", TOWN, "-o", &place.path("adjusted"), "-q"]);
    let cost = |name: &str, resolution: &str| -> TileCost {
        copy_folder(&place.file("adjusted"), &place.file(name));
        let run = place.path(name);
        let more = ["--core", "200", "--iterations", "30", "--resolution", resolution];
        succeeds(&joined(&["plan", TOWN, "-o", &run], &more));
        Plan::read(&place.file(name)).unwrap().total
    };
    let (usual, fine) = (cost("usual", "0.5"), cost("fine", "0.02"));
    assert!(usual.memory_mb < 450.0, "{usual:?}");
    // 3,466 MB and five minutes were measured.
    assert!((3466.0..4500.0).contains(&fine.memory_mb) && fine.seconds_2core > 100.0, "{fine:?}");
    // More than any machine has.
    cost("finest", "0.0005");
    refused(&["tile", "run", &place.path("finest"), "--index", "0"], 75, &["MB of memory, this machine has"]);
    let adjusted = place.path("adjusted");
    let within = ["--core", "200", "--iterations", "30", "--resolution", "0.02", "--max-memory", "1GB"];
    let limited = joined(&["plan", TOWN, "-o", &adjusted], &within);
    refused(&limited, 2, &["--max-memory is 1000 MB"]);
}

#[test]
fn an_area_at_the_border_of_two_zones_is_planned_in_one() {
    let Some(input) = input("zone_border") else { return };
    let (place, scene) = (Place::new(), input.join("scene"));
    let areas = ["5.9996,43.2997,6.0,43.3003", "6.0,43.2997,6.0004,43.3003", "5.9996,43.2997,6.0004,43.3003"];
    for (name, aoi) in ["west", "east", "both"].into_iter().zip(areas) {
        let run = place.path(name);
        let tiling = ["--core", "30", "--overlap", "5", "--iterations", "5", "--aoi", aoi];
        succeeds(&joined(&["plan", scene.to_str().unwrap(), "-o", &run], &tiling));
        let plan = Plan::read(&place.file(name)).unwrap();
        assert!([32631, 32632].contains(&plan.epsg) && plan.tiles.len() > 1, "{name}: {}", plan.tiles.len());
    }
}

#[test]
fn cells_of_masked_pixels_are_no_confirmed_ones() {
    let place = Place::new();
    succeeds(&["simulate", &place.path("town"), "--size", "140", "--views", "4", "-q"]);
    let valid = |i: usize| if i % 140 < 35 { 0 } else { 255 };
    let mask = SensorImage { width: 140, height: 140, rpc: &[], metadata: &[] };
    mask.write_u8(&place.file("mask.tif"), vec![(0..140 * 140).map(valid).collect()]).unwrap();
    let view = |i: usize| format!("[[view]]\nimage = \"town/VIEW_0{i}.tif\"\nmask = \"mask.tif\"\n");
    std::fs::write(place.file("masked.toml"), (1..5).map(view).collect::<String>()).unwrap();
    let runs = [(place.path("town"), "all"), (place.path("masked.toml"), "masked")];
    let [all, masked] = runs.map(|(scene, name)| {
        let run = place.path(name);
        let like = ["--like", &place.path("town/truth/TOWN_DSM.tif")].map(String::from);
        let run_of = ["run", &scene, "-o", &run, "--iterations", "5", &like[0], &like[1]];
        told(&run_of)["dsm"]["cells"].clone()
    });
    let count = |cells: &Value, key: &str| cells[key].as_u64().unwrap();
    assert!(count(&masked, "with_height") < count(&all, "with_height"), "{all} {masked}");
    let views = band(&place.file("masked/confidence.tif"), 3);
    let heights = band(&place.file("masked/dsm.tif"), 1);
    let unseen = views.data.iter().zip(&heights.data).filter(|(v, z)| **v >= 2.0 && z.is_nan()).count();
    assert_eq!(unseen, 0, "what has no height is not confirmed");
}
