//! Splats predicted from points in one pass: `satgs predict`, and what is refused.

use crate::common::perspective::depth_png;
use crate::common::{refused, satgs, succeeds, text};
use satgs::frame::{Point, SiteGrid, Transform};
use satgs::io::{CloudPoint, ImageFile, PointCloud, VerticalReference};
use serde_json::Value;
use std::path::Path;

/// A town, an adjusted run of it, and its exact surface as points.
struct Town {
    folder: tempfile::TempDir,
}

impl Town {
    fn new() -> Self {
        let town = Self { folder: tempfile::tempdir().unwrap() };
        let scene = town.path("scene");
        succeeds(&["simulate", &scene, "--views", "6", "--size", "160", "--held-out", "1", "-q"]);
        succeeds(&["ba", &scene, "-o", &town.path("run"), "-q"]);
        town
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    fn surface(&self) -> String {
        self.path("scene/truth/TOWN_DSM.tif")
    }

    fn write(&self, name: &str, content: &[u8]) -> String {
        std::fs::write(self.path(name), content).unwrap();
        self.path(name)
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        std::fs::read(self.path(name)).unwrap()
    }

    /// The cells of the exact surface: map coordinates of its zone, and ellipsoidal heights.
    fn points(&self) -> (u32, Vec<[f64; 3]>) {
        let file = ImageFile::open(Path::new(&self.surface())).unwrap();
        let (grid, heights) = (file.map_grid().unwrap(), file.read(1).unwrap());
        let at = |i: usize| {
            let p = grid.cell_center(i % grid.width, i / grid.width);
            [p.x(), p.y(), f64::from(heights.data[i])]
        };
        (grid.epsg, (0..heights.data.len()).map(at).collect())
    }

    /// Mean position of the splats of a run, metres from the origin of its site.
    fn mean_position(&self, run: &str) -> [f64; 3] {
        let splats = satgs::splat::ply::read(Path::new(&self.path(&format!("{run}/splats.ply")))).unwrap();
        let mean =
            |k: usize| splats.position.iter().map(|p| f64::from(p[k])).sum::<f64>() / splats.len() as f64;
        [mean(0), mean(1), mean(2)]
    }

    /// Predicts, and returns the summary.
    fn predict(&self, out: &str, more: &[&str]) -> Value {
        let (run, out) = (self.path("run"), self.path(out));
        let output = succeeds(&[&["predict", &run, "-o", &out, "--json"][..], more].concat());
        serde_json::from_slice(&output.stdout).unwrap()
    }
}

/// One town for all checks: its adjustment takes longer than they do.
#[test]
fn splats_are_predicted_of_points_of_any_source_and_what_cannot_be_points_is_refused() {
    let town = Town::new();
    the_prediction_shows_the_town_and_training_goes_on_from_it(&town);
    a_second_call_keeps_the_prediction_and_one_of_other_points_is_refused(&town);
    clouds_in_another_zone_give_the_same_surface(&town);
    wrong_points_and_models_are_refused_with_the_reason(&town);
}

fn the_prediction_shows_the_town_and_training_goes_on_from_it(town: &Town) {
    let predicted = town.predict("predicted", &["--points", &town.surface(), "--threads", "1"]);
    let splats = predicted["splats"].as_u64().unwrap();
    assert!(splats > 10_000, "{predicted}");
    town.predict("again", &["--points", &town.surface(), "--threads", "2"]);
    assert!(town.bytes("predicted/splats.ply") == town.bytes("again/splats.ply"));
    let run = town.path("predicted");
    succeeds(&["dsm", &run, "-q"]);
    let scores = succeeds(&["dsm-eval", &town.path("predicted/dsm.tif"), &town.surface(), "--json"]);
    let scores: Value = serde_json::from_slice(&scores.stdout).unwrap();
    // The last registration is that in three dimensions.
    let registered = scores["registered_scores"].as_array().and_then(|all| all.last()).unwrap();
    let mae = registered["mae_m"].as_f64().unwrap();
    assert!(mae < 1.2, "{mae} m from the surface that it was predicted from");
    let network = score(town, "predicted");
    town.predict("flat", &["--points", &town.surface(), "--without-network", "flat"]);
    let flat = score(town, "flat");
    assert!(network > flat, "{network} dB with the network, {flat} dB without");
    let trained = succeeds(&["train", &run, "--iterations", "3", "--json"]);
    let trained: Value = serde_json::from_slice(&trained.stdout).unwrap();
    assert_eq!(trained["splats_start"].as_u64(), Some(splats), "{trained}");
    succeeds(&["dsm", &run, "--overwrite", "-q"]);
    succeeds(&["align", &run, "--to", &town.surface(), "-q"]);
    let said = satgs(&["train", &run, "--iterations", "3"]);
    assert!(text(&said).contains("is trained already"), "{}", text(&said));
    // Another adjustment in the folder has nothing to do with the splats.
    succeeds(&["ba", &town.path("scene"), "-o", &run, "--gamma", "1.1", "--overwrite", "-q"]);
    let trained =
        succeeds(&["train", &run, "--recipe", "baeogs", "--iterations", "3", "--overwrite", "--json"]);
    let trained: Value = serde_json::from_slice(&trained.stdout).unwrap();
    assert_ne!(trained["splats_start"].as_u64(), Some(splats), "{trained}");
}

/// PSNR of the view that is held out, dB.
fn score(town: &Town, run: &str) -> f64 {
    let scores = succeeds(&["nvs-eval", &town.path(run), "--json"]);
    let scores: Value = serde_json::from_slice(&scores.stdout).unwrap();
    let found = find(&scores, "psnr_db").unwrap_or_else(|| panic!("{scores}"));
    found.as_f64().unwrap()
}

/// The first value of this name.
fn find<'a>(value: &'a Value, name: &str) -> Option<&'a Value> {
    match value {
        Value::Object(fields) => fields.get(name).or_else(|| fields.values().find_map(|v| find(v, name))),
        Value::Array(items) => items.iter().find_map(|v| find(v, name)),
        _ => None,
    }
}

fn a_second_call_keeps_the_prediction_and_one_of_other_points_is_refused(town: &Town) {
    let before = town.bytes("flat/splats.ply");
    town.predict("flat", &["--points", &town.surface(), "--without-network", "flat"]);
    assert!(town.bytes("flat/splats.ply") == before);
    let (run, out, surface) = (town.path("run"), town.path("flat"), town.surface());
    refused(&["predict", &run, "-o", &out, "--points", &surface], 2, &["--without-network"]);
    refused(&["predict", &run, "-o", &run, "--points", &surface], 2, &["run"]);
    let other = town.path("other");
    succeeds(&["ba", &town.path("scene"), "-o", &other, "-q"]);
    refused(&["predict", &run, "-o", &other, "--points", &surface], 2, &["not of a prediction"]);
}

fn clouds_in_another_zone_give_the_same_surface(town: &Town) {
    let (epsg, points) = town.points();
    let other = if epsg == 32631 { 32632 } else { 32631 };
    let transform = Transform::new(epsg, other).unwrap();
    let places = points.iter().map(|p| {
        let (x, y) = transform.convert(p[0], p[1]);
        Point::new(x, y, p[2])
    });
    let places: Vec<_> = places.collect();
    let origin = Point::new(places[0].x().round(), places[0].y().round(), 0.0);
    let cloud = PointCloud { epsg: other, vertical: &VerticalReference::Ellipsoid, origin };
    let colored = |place: &Point<_>| CloudPoint { place: *place, color: [0.5; 3], intensity: 0 };
    cloud.write(Path::new(&town.path("points.laz")), places.iter().map(colored)).unwrap();
    let ply = |points: &[[f64; 3]], origin: [f64; 3]| {
        let header = format!(
            "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\nend_header\n",
            points.len()
        );
        let line = |p: &[f64; 3]| format!("{} {} {}\n", p[0] - origin[0], p[1] - origin[1], p[2] - origin[2]);
        header + &points.iter().map(line).collect::<String>()
    };
    let map = town.write("map.ply", ply(&points, [0.0; 3]).as_bytes());
    let site = SiteGrid { epsg, origin: Point::new(points[0][0], points[0][1], 100.0) };
    let local = town.write("local.ply", ply(&points, site.origin.xyz()).as_bytes());
    satgs::io::write_georeference(Path::new(&local), &site).unwrap();
    let expected = town.predict("of_raster", &["--points", &town.surface()]);
    let splats = |summary: &Value| find(summary, "splats").and_then(Value::as_f64).unwrap();
    for (k, file) in [town.path("points.laz"), map, local].into_iter().enumerate() {
        let found = town.predict(&format!("of_{k}"), &["--points", &file]);
        let ratio = splats(&found) / splats(&expected);
        assert!((ratio - 1.0).abs() < 0.02, "{file}: {found} {expected}");
        let [own, other] = [format!("of_{k}"), "of_raster".into()].map(|run| town.mean_position(&run));
        let off = (0..3).map(|k| (own[k] - other[k]).abs()).fold(0.0, f64::max);
        assert!(off < 0.2, "{file}: {own:?} {other:?}");
    }
}

fn wrong_points_and_models_are_refused_with_the_reason(town: &Town) {
    let (run, out) = (town.path("run"), town.path("out"));
    let with = |option: &str, file: &str, says: &[&str]| {
        refused(&["predict", &run, "-o", &out, option, file], 2, says);
    };
    let header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let elsewhere = town.write("elsewhere.ply", format!("{header}1 2 3\n4 5 6\n").as_bytes());
    with("--points", &elsewhere, &["do not belong to the cameras"]);
    let nan = town.write("nan.ply", format!("{header}nan nan nan\nnan 5 6\n").as_bytes());
    with("--points", &nan, &["nan.ply", "no point of it"]);
    // Heights that are 20 m too high, as of another vertical reference.
    let (_, points) = town.points();
    let line = |p: &[f64; 3]| format!("{} {} {}\n", p[0], p[1], p[2] + 20.0);
    let count = header.replace("vertex 2", &format!("vertex {}", points.len())).replace("float", "double");
    let high = town.write("high.ply", (count + &points.iter().map(line).collect::<String>()).as_bytes());
    let said = satgs(&["predict", &run, "-o", &town.path("high"), "--points", &high]);
    assert!(text(&said).contains("vertical reference"), "{}", text(&said));
    let cut = town.write("cut.ply", format!("{header}1 2 3\n").as_bytes());
    with("--points", &cut, &["cut.ply", "ends before the last"]);
    let no_cloud = town.write("no.laz", b"LASF");
    with("--points", &no_cloud, &["no.laz"]);
    let image = town.path("scene/VIEW_01.tif");
    with("--points", &image, &["VIEW_01.tif"]);
    with("--points", &town.path("none.tif"), &["none.tif"]);
    with("--points", &town.path("scene/test.txt"), &["expected a file that ends in"]);
    let model = town.write("model.safetensors", b"\x08\0\0\0\0\0\0\0{}      ");
    with("--model", &model, &["model.safetensors", "not a model of this version"]);
    with("--model", &town.path("none.safetensors"), &["none.safetensors"]);
    refused(&["predict", &town.path("scene"), "-o", &out], 2, &["satgs ba"]);
}

#[test]
fn splats_of_photographs_are_predicted_from_their_points_and_training_goes_on_from_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (room, out, flat) = (path("room"), path("out"), path("flat"));
    succeeds(&["simulate", &room, "--room", "--views", "10", "--size", "160", "-q"]);
    let predict = |out: &str, more: &[&str]| {
        let output =
            succeeds(&[&["predict", &room, "-o", out, "--test-views", "5", "--json"][..], more].concat());
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let of_towns = concat!(env!("CARGO_MANIFEST_DIR"), "/data/models/points-to-splats.safetensors");
    let predicted = predict(&out, &["--model", of_towns]);
    predict(&flat, &["--without-network", "flat"]);
    // The model of the program has seen towns only.
    predict(&path("plain"), &[]);
    let bytes = |run: &str| std::fs::read(Path::new(run).join("splats.ply")).unwrap();
    assert!(bytes(&path("plain")) == bytes(&flat), "without a model splats of photographs are flat");
    let psnr = |run: &str| {
        let scores = succeeds(&["nvs-eval", run, "--json"]);
        find(&serde_json::from_slice(&scores.stdout).unwrap(), "psnr_db").unwrap().as_f64().unwrap()
    };
    // Two walls have no points: most of what is wrong is the same for both.
    assert!(psnr(&out) > psnr(&flat) - 1.0, "{} {}", psnr(&out), psnr(&flat));
    let splats = satgs::splat::ply::read(&Path::new(&out).join("splats.ply")).unwrap();
    let inside = splats.position.iter().filter(|p| (0..3).all(|k| p[k].abs() < 2.7)).count();
    assert!(inside > 20_000 && inside * 100 > splats.len() * 98, "{inside} of {}", splats.len());
    let trained = succeeds(&["train", &out, "--iterations", "3", "--json"]);
    let trained: Value = serde_json::from_slice(&trained.stdout).unwrap();
    assert_eq!(find(&trained, "splats_start"), find(&predicted, "splats"));
    // Photographs often lie in a folder `train`: nothing of the scene may be removed.
    let image = folder.path().join("room/train/0001.png");
    std::fs::create_dir_all(image.parent().unwrap()).unwrap();
    std::fs::write(&image, b"an image").unwrap();
    for more in [&[][..], &["--overwrite"]] {
        refused(&[&["predict", &room, "-o", &room][..], more].concat(), 2, &["not of a prediction"]);
        assert!(image.exists());
    }
    let lidar = folder.path().join("points.laz");
    std::fs::write(&lidar, b"LASF").unwrap();
    let lidar = lidar.to_str().unwrap();
    refused(&["predict", &room, "-o", &path("other"), "--points", lidar], 2, &["no place on Earth"]);
}

/// RGB-D frames of a painted wall at z = 3 m, each taken from 0.1 m further to the right than the one before.
fn frames(folder: &Path, count: usize) {
    const SIZE: (usize, usize) = (120, 90);
    let write = |name: String, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("camera-intrinsics.txt".into(), "100 0 59.5\n0 100 44.5\n0 0 1\n");
    for frame in 0..count {
        let x = 0.1 * frame as f64;
        let pixel = |i: usize| {
            let (u, v) = (x + 0.03 * (i % SIZE.0) as f64, 0.03 * (i / SIZE.0) as f64);
            [(4.0 * u).sin(), (5.0 * v).cos(), (3.0 * (u + v)).sin()].map(|c| (128.0 + 100.0 * c) as u8)
        };
        let rgb: Vec<u8> = (0..SIZE.0 * SIZE.1).flat_map(pixel).collect();
        satgs::io::write_png_rgb(&folder.join(format!("f{frame}.color.png")), SIZE.0, SIZE.1, &rgb).unwrap();
        depth_png(&folder.join(format!("f{frame}.depth.png")), SIZE, |_, _| 3000);
        write(format!("f{frame}.pose.txt"), &format!("1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"));
    }
}

#[test]
fn a_model_that_is_trained_further_on_photographs_shows_held_back_views_better_than_splats_without_a_network()
{
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(folder.path().join("wall")).unwrap();
    frames(&folder.path().join("wall"), 10);
    std::fs::write(folder.path().join("short.toml"), "rounds = 3\nsteps = 16\ntiles = 2\nviews = 3\n")
        .unwrap();
    let learn = |out: &str, more: &[&str]| {
        let (out, wall, config) = (path(out), path("wall"), path("short.toml"));
        let common = ["learn", &out, "--scenes", &wall, "--config", &config, "--test-views", "4", "--json"];
        let output = succeeds(&[&common[..], more].concat());
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    };
    let summary = learn("a.safetensors", &[]);
    let scores = find(&summary, "dense").unwrap().as_array().unwrap().clone();
    let scores: Vec<f64> = scores.iter().map(|v| v.as_f64().unwrap()).collect();
    assert!(scores[0] > 15.0 && scores[0] > scores[1].max(scores[2]), "{scores:?}");
    learn("b.safetensors", &["--threads", "1"]);
    let bytes = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(bytes("a.safetensors") == bytes("b.safetensors"), "the number of threads changes the model");
    assert!(bytes("a.learn/points.csv").len() > 60);
    let model = path("a.safetensors");
    succeeds(&["predict", &path("wall"), "-o", &path("run"), "--model", &model, "--test-views", "4", "-q"]);
    // Another start is another training; a scene needs depth maps.
    let (wall, config, other) = (path("wall"), path("short.toml"), path("b.safetensors"));
    let again = ["learn", &model, "--scenes", &wall, "--config", &config];
    succeeds(&[&again[..], &["--test-views", "4", "-q"]].concat());
    for more in [
        &["--test-views", "4", "--from", &other][..],
        &["--test-views", "3"],
        &["--test-views", "4", "--downsampling", "2"],
    ] {
        refused(&[&again[..], more].concat(), 2, &["another configuration"]);
    }
    for frame in 0..10 {
        std::fs::remove_file(folder.path().join(format!("wall/f{frame}.depth.png"))).unwrap();
    }
    refused(&["learn", &path("c.safetensors"), "--scenes", &path("wall")], 2, &["wall"]);
    refused(&["learn", &path("c.safetensors"), "--test-views", "4"], 2, &["--scenes"]);
}

#[test]
fn a_model_takes_the_image_features_of_a_network_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    std::fs::create_dir(folder.path().join("wall")).unwrap();
    frames(&folder.path().join("wall"), 6);
    let config =
        "towns = 1\nrounds = 2\nsteps = 8\ntiles = 2\nviews = 3\nsize_px = 160\nvalidation_towns = 1\n";
    std::fs::write(folder.path().join("short.toml"), config).unwrap();
    let (wall, config, network) = (path("wall"), path("short.toml"), "tests/data/tiny_features.onnx");
    let (towns, rooms, onnx) = (path("towns.safetensors"), path("rooms.safetensors"), path("towns.onnx"));
    succeeds(&["learn", &towns, "--config", &config, "--image-features", network, "-q"]);
    let further = ["learn", &rooms, "--scenes", &wall, "--config", &config, "--from", &towns];
    refused(&further, 2, &["was trained with a network"]);
    succeeds(&[&further[..], &["--image-features", network, "-q"]].concat());
    succeeds(&["learn", &onnx, "--from", &rooms, "-q"]);
    let psnr = |name: &str, model: &str| {
        let run = path(name);
        let predict = ["predict", &wall, "-o", &run, "--model", model];
        refused(&predict, 2, &["was trained with a network"]);
        succeeds(&[&predict[..], &["--image-features", network]].concat());
        let scores = succeeds(&["nvs-eval", &run, "--json"]);
        find(&serde_json::from_slice(&scores.stdout).unwrap(), "psnr_db").unwrap().as_f64().unwrap()
    };
    let own = psnr("own", &rooms);
    assert!(own > 12.0 && (own - psnr("other", &onnx)).abs() < 0.01, "{own}");
    let other = path("a.safetensors");
    let built_in = ["learn", &other, "--scenes", &wall, "--image-features", network];
    refused(&built_in, 2, &["was trained without a network"]);
    refused(&["learn", &other, "--image-features", &config], 2, &["short.toml"]);
}
