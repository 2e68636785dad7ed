//! From simulated images to a scored surface model, through the binary: shifts, heights, files, resuming.

use crate::common::{copy_folder, disagreement_px, satgs, satgs_in, scenes, text};
use base64::prelude::{BASE64_STANDARD, Engine};
use satgs::frame::Pixel;
use satgs::io::ImageFile;
use satgs::rpc::{Rpc, formats};
use serde_json::Value;
use std::path::Path;

/// Largest distance of a corrected camera from the true one, once the translation of the whole scene, which tie
/// points leave open, is taken out.
const SHIFT_TOLERANCE_PX: f64 = 0.1;
/// Mean absolute error of the surface after a short training on small images: 0.63 m was seen; the town's own mean
/// absolute deviation is over 5 m.
const MAE_TOLERANCE_M: f64 = 1.0;

fn json(path: &Path) -> Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

#[test]
fn a_surface_model_is_made_from_simulated_images() {
    let folder = tempfile::tempdir().unwrap();
    let (scene, run) = (folder.path().join("scene"), folder.path().join("run"));
    let (scene, run) = (scene.to_str().unwrap(), run.to_str().unwrap());
    let made = satgs(&["simulate", scene, "--size", "260", "--views", "8", "-q"]);
    assert!(made.status.success(), "{}", text(&made));

    // What a late stage cannot take is known before hours of training.
    let [folder_of_truth, table, cut] =
        ["truth", "views.csv", "truth/CUT.tif"].map(|name| format!("{scene}/{name}"));
    let whole = std::fs::read(format!("{scene}/truth/TOWN_DSM.tif")).unwrap();
    std::fs::write(&cut, &whole[..whole.len() / 2]).unwrap();
    for [option, wrong] in [
        ["--truth", &cut],
        ["--truth", &folder_of_truth],
        ["--truth", &table],
        ["--truth", "none.tif"],
        ["--vertical", "none.gtx"],
        ["--like", &table],
        ["--recipe", "none.toml"],
        ["--resolution", "0"],
    ] {
        let output = satgs(&["run", scene, "-o", run, option, wrong]);
        assert_eq!(output.status.code(), Some(2), "{option}: {}", text(&output));
        assert!(text(&output).contains(wrong) && !Path::new(run).exists(), "{option}: {}", text(&output));
    }

    let truth = format!("{scene}/truth/TOWN_DSM.tif");
    let all = ["run", scene, "-o", run, "--truth", &truth, "--iterations", "300", "--json"];
    let output = satgs(&all);
    assert!(output.status.success(), "{}", text(&output));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(summary["ba"]["tracks"].as_u64().unwrap() > 300, "{summary}");

    let worst = worst_shift_px(Path::new(scene), Path::new(run));
    assert!(worst < SHIFT_TOLERANCE_PX, "corrected cameras are {worst:.3} px off");

    let metrics = json(&Path::new(run).join("eval/metrics.json"));
    let registered_scores = metrics["registered_scores"].as_array().unwrap();
    let xyz = registered_scores.iter().find(|v| v["method"] == "xyz").unwrap();
    let score = |key: &str| xyz[key].as_f64().unwrap();
    assert!(score("mae_m") < MAE_TOLERANCE_M, "{xyz:#}");
    assert!(score("completeness") > 0.97, "{xyz:#}");

    for name in ["dsm.tif", "ortho.tif"] {
        let file = ImageFile::open(&Path::new(run).join(name)).unwrap();
        assert_eq!(file.map_grid().unwrap().epsg / 100, 326);
        assert_eq!(file.metadata("LAYOUT", "IMAGE_STRUCTURE").unwrap(), "COG");
    }
    for name in
        ["scene.json", "cameras.json", "splats.ply", "splats.georef.json", "hillshade.png", "ba/points.laz"]
    {
        assert!(Path::new(run).join(name).exists(), "{name}");
    }

    assert_page(&Path::new(run).join("report.html"), 0);
    let begun = folder.path().join("begun");
    std::fs::create_dir(&begun).unwrap();
    std::fs::copy(Path::new(run).join("scene.json"), begun.join("scene.json")).unwrap();
    assert!(satgs(&["report", begun.to_str().unwrap()]).status.success());
    assert_page(&begun.join("report.html"), 4);
    let nothing = satgs(&["report", folder.path().to_str().unwrap()]);
    assert_eq!(nothing.status.code(), Some(2));
    assert!(text(&nothing).contains("holds no run"), "{}", text(&nothing));
    other_products(run, folder.path());

    // What is there is kept, what differs is refused by name.
    let before = std::fs::read(Path::new(run).join("splats.ply")).unwrap();
    let again = satgs(&all);
    assert!(again.status.success() && text(&again).contains("is trained already"), "{}", text(&again));
    assert_eq!(std::fs::read(Path::new(run).join("splats.ply")).unwrap(), before);
    let other = satgs(&["train", run, "--iterations", "301"]);
    assert_eq!(other.status.code(), Some(2));
    assert!(text(&other).contains("iterations was 300, is 301"), "{}", text(&other));
    assert!(text(&other).contains("hint: `satgs train RUN --overwrite`"), "{}", text(&other));

    // Asked to, a stage is made anew of the same things too.
    let command = || json(&Path::new(run).join("dsm/stage.json"))["command"].as_str().unwrap().to_owned();
    assert!(satgs(&["dsm", run]).status.success() && !command().ends_with("-v"), "{}", command());
    assert!(satgs(&["dsm", run, "--overwrite", "-v"]).status.success() && command().ends_with("-v"));
    aligned_to(&truth, run);
}

#[test]
fn a_run_finds_its_scene_from_another_folder_and_after_a_move() {
    let folder = tempfile::tempdir().unwrap();
    let from_folder = |args: &[&str]| {
        let output = satgs_in(folder.path(), args);
        assert!(output.status.success(), "{}", text(&output));
        text(&output)
    };
    let images_in = |place: &str| {
        let scene = json(&folder.path().join("run/scene.json"));
        let views = scene["views"].as_array().unwrap();
        views.iter().all(|v| {
            let image = Path::new(v["image"].as_str().unwrap());
            image.is_file() && image.parent().unwrap() == folder.path().join(place)
        })
    };
    copy_folder(scenes::town(), &folder.path().join("scene"));
    from_folder(&["ba", "scene", "-o", "run", "-q"]);
    assert!(images_in("scene"));
    std::fs::rename(folder.path().join("scene"), folder.path().join("moved")).unwrap();
    let gone = satgs(&["train", folder.path().join("run").to_str().unwrap()]);
    assert_eq!(gone.status.code(), Some(2));
    assert!(
        text(&gone).contains("VIEW_01.tif`, which does not exist") && text(&gone).contains("hint: `satgs ba"),
        "{}",
        text(&gone)
    );
    assert!(from_folder(&["ba", "moved", "-o", "run"]).contains("is adjusted already"));
    assert!(images_in("moved"));
}

/// Cameras, splats and surfaces move together, and later stages go on from there.
fn aligned_to(truth: &str, run: &str) {
    let file = |name: &str| Path::new(run).join(name);
    let origin = || {
        let georef = json(&file("splats.georef.json"));
        ["easting_m", "northing_m", "height_m"].map(|k| georef["origin"][k].as_f64().unwrap())
    };
    let rasters = ["dsm.tif", "train/surface.tif", "train/first_surface.tif", "ortho.tif", "confidence.tif"];
    let corner = |name: &str| {
        let grid = ImageFile::open(&file(name)).unwrap().map_grid().unwrap();
        [grid.west, grid.north]
    };
    let height = || ImageFile::open(&file("dsm.tif")).unwrap().read(1).unwrap().valid().next().unwrap();
    let (origin_before, corners, height_before) = (origin(), rasters.map(corner), height());
    let moved = satgs(&["align", run, "--to", truth, "-q"]);
    assert!(moved.status.success(), "{}", text(&moved));
    let shift = &json(&file("align.json"))["shift"];
    let [east, north, up] = ["east_m", "north_m", "up_m"].map(|k| shift[k].as_f64().unwrap());
    assert!(east.hypot(north).hypot(up) > 0.01, "{shift}");
    for ((now, before), by) in origin().iter().zip(origin_before).zip([east, north, up]) {
        assert!((now - before - by).abs() < 1e-6, "{shift}");
    }
    for (name, before) in rasters.iter().zip(corners) {
        let now = corner(name);
        assert!((now[0] - before[0] - east).hypot(now[1] - before[1] - north) < 1e-6, "{name} {shift}");
    }
    assert!((f64::from(height() - height_before) - up).abs() < 1e-3, "{shift}");
    for (args, says) in
        [(&["dsm", run][..], "dsm.tif"), (&["train", run, "--iterations", "300"], "is trained already")]
    {
        let output = satgs(args);
        let all = [text(&output), String::from_utf8_lossy(&output.stdout).into_owned()].concat();
        assert!(output.status.success() && all.contains(says), "{args:?}: {all}");
    }
}

/// Heights above a geoid, points, a mesh, pictures and their scores of a trained run.
fn other_products(run: &str, folder: &Path) {
    let file = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let succeeds = |args: &[&str]| {
        let output = satgs(args);
        assert!(output.status.success(), "{args:?}: {}", text(&output));
        output
    };
    let (points, mesh) = (Path::new(run).join("dsm.laz"), Path::new(run).join("dsm.glb"));
    let ellipsoidal = ImageFile::open(&Path::new(run).join("dsm.tif")).unwrap().read(1).unwrap();
    let above = ["dsm", run, "--vertical", "EGM96", "--fill", "2", "--hillshade", "--points", "dsm.laz"];
    let above = [&above[..], &["--mesh", "dsm.glb"]].concat();
    let output = satgs_in(Path::new(run), &[&above[..], &["--overwrite", "-q"]].concat());
    assert!(output.status.success(), "{}", text(&output));
    // Wherever the command is given, paths of products count from the run.
    let again = satgs_in(folder, &above);
    assert!(text(&again).contains("has its surface already"), "{}", text(&again));
    let dsm = ImageFile::open(&Path::new(run).join("dsm.tif")).unwrap();
    assert_eq!(dsm.metadata("VERTICAL_REFERENCE", "").unwrap(), "EGM96");
    assert_eq!(dsm.map_grid().unwrap().epsg / 100, 326, "the heights' CRS is not the map's");
    let tag = |key: &str| dsm.metadata(key, "").unwrap();
    assert!(
        tag("TIFFTAG_SOFTWARE").starts_with("satgs 0.") && tag("INPUTS").starts_with("VIEW_01, VIEW_02, ")
    );
    let geoid = dsm.read(1).unwrap();
    let middle = ellipsoidal.width / 2;
    let undulation_m = ellipsoidal.at(middle, middle) - geoid.at(middle, middle);
    // EGM96 near Marseille, where the town is simulated, lies 48 to 50 m above the ellipsoid.
    assert!((48.0..50.0).contains(&undulation_m), "{undulation_m}");
    let shade = ImageFile::open(&Path::new(run).join("hillshade.tif")).unwrap();
    assert_eq!(shade.map_grid().unwrap(), dsm.map_grid().unwrap());
    assert!(shade.band(1).unwrap().is_byte);
    // Cells beside holes have no slope.
    let shaded = shade.read(1).unwrap().valid().count() as f64 / geoid.valid().count() as f64;
    assert!((0.9..=1.0).contains(&shaded), "{shaded}");
    let style = std::fs::read_to_string(Path::new(run).join("dsm.qml")).unwrap();
    let items = style.split("<item value=\"").skip(1).map(|i| i.split('"').next().unwrap());
    let stops: Vec<f32> = items.map(|value| value.parse().unwrap()).collect();
    let (low, high) = geoid.valid().fold((f32::MAX, f32::MIN), |(l, h), z| (l.min(z), h.max(z)));
    assert!(stops.is_sorted() && stops.len() == 5 && low < stops[0] && stops[4] < high, "{stops:?}");
    let confidence = ImageFile::open(&Path::new(run).join("confidence.tif")).unwrap();
    let views = confidence.read(3).unwrap();
    assert!(views.valid().all(|v| (0.0..=8.0).contains(&v)) && views.at(middle, middle) >= 2.0);
    assert!(points.metadata().unwrap().len() > 10_000);
    assert!(std::fs::read(&mesh).unwrap().starts_with(b"glTF"));

    let (like, seen, map) = (file("like.png"), file("seen.tif"), file("map.tif"));
    succeeds(&["render", run, "--like", "VIEW_03", "-o", &like]);
    succeeds(&["render", run, "--like", "VIEW_03", "-o", &seen]);
    let seen = Path::new(&seen);
    let corrected = formats::read(&Path::new(run).join("ba/rpcs/VIEW_03.json")).unwrap().rpc;
    assert_eq!(formats::from_tiff(seen).unwrap(), Some(corrected));
    let heights = ImageFile::open(seen).unwrap().read(4).unwrap();
    let (low, high) = ellipsoidal.valid().fold((f32::MAX, f32::MIN), |(l, h), z| (l.min(z), h.max(z)));
    let height = heights.at(heights.width / 2, heights.height / 2);
    assert!(low - 1.0 < height && height < high + 1.0, "{height}");
    succeeds(&["render", run, "--view", "90,20", "--sun", "200,40", "--size", "200,150", "-o", &map]);
    assert_eq!(ImageFile::open(Path::new(&map)).unwrap().size(), (200, 150));
    succeeds(&["dsm", run, "--overwrite", "-q"]);
    let scored = succeeds(&["nvs-eval", run, "--view", "VIEW_03", "--json", "-q"]);
    let summary: Value = serde_json::from_slice(&scored.stdout).unwrap();
    let psnr_db = summary["views"][0]["score"]["psnr_db"].as_f64().unwrap();
    assert!(psnr_db > 17.0, "{summary}");
    for (args, says) in [
        (&["render", run, "--like", "VIEW_99", "-o", &like][..], "no view `VIEW_99`"),
        (&["render", run, "--view", "0,89", "-o", &like], "1° above the horizon"),
        (&["render", run, "--view", "0,0", "-o", "x.jpg"], "`x.jpg` is not the name of an image"),
        (&["nvs-eval", run], "no test view"),
        (&["dsm", run, "--overwrite", "--vertical", "EGM1066"], "EGM1066"),
        (&["dsm", run, "--points", "x.txt"], "ends in .laz or .las"),
    ] {
        let refused = satgs(args);
        assert_eq!(refused.status.code(), Some(2), "{args:?}");
        assert!(text(&refused).contains(says), "{args:?}: {}", text(&refused));
    }
}

/// The corrected cameras against the true ones.
fn worst_shift_px(scene: &Path, run: &Path) -> f64 {
    let camera = |folder: &Path, name: &str| -> Rpc {
        formats::read(&folder.join(format!("{name}.json"))).unwrap().rpc
    };
    let report = json(&run.join("ba/report.json"));
    let names = report["views"].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap());
    let pairs: Vec<(Rpc, Rpc)> = names
        .map(|name| (camera(&run.join("ba/rpcs"), name), camera(&scene.join("truth/rpcs"), name)))
        .collect();
    disagreement_px(&pairs, Pixel::new(130.0, 130.0)).into_iter().fold(0.0, f64::max)
}

/// The page has every section, asks for nothing outside of itself, and its pictures can be decoded; so many stages are
/// said to be missing.
fn assert_page(path: &Path, missing: usize) {
    let page = std::fs::read_to_string(path).unwrap();
    for id in ["result", "inputs", "adjustment", "training", "surface", "scores", "commands"] {
        assert!(page.contains(&format!("<section id=\"{id}\">")), "{id}");
        assert!(page.contains(&format!("href=\"#{id}\"")), "{id}");
    }
    assert_eq!(page.matches("Not available yet").count(), missing);
    for (i, _) in page.match_indices("src=\"").chain(page.match_indices("href=\"")) {
        let target = page[i..].split('"').nth(1).unwrap();
        assert!(target.starts_with("data:") || target.starts_with('#'), "{target:.40}");
    }
    for outside in ["url(", "@import", "fetch(", "<link rel=\"stylesheet", "<iframe"] {
        assert!(!page.contains(outside), "{outside}");
    }
    let pictures: Vec<&str> = page.split("data:image/png;base64,").skip(1).collect();
    // Eight views; surface, orthophoto, confidence, and the pair with its colours.
    assert_eq!(pictures.len(), if missing == 0 { 14 } else { 8 });
    for picture in pictures {
        let (data, rest) = picture.split_once('"').unwrap();
        image::load_from_memory_with_format(&BASE64_STANDARD.decode(data).unwrap(), image::ImageFormat::Png)
            .unwrap();
        let alt = rest.split_once("alt=\"").unwrap().1;
        assert!(!alt.starts_with('"'), "a picture without words");
    }
    for svg in page.split("<svg ").skip(1) {
        let svg = format!("<svg {}</svg>", svg.split_once("</svg>").unwrap().0);
        let xml = roxmltree::Document::parse(&svg).unwrap();
        assert!(xml.root_element().attribute("aria-label").is_some());
    }
    assert_eq!(page.matches("<svg ").count(), if missing == 0 { 13 } else { 2 });
}
