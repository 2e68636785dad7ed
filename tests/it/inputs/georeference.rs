//! Georeferences, control, alignment and comparison with meshes and surfaces.

use super::input;
use crate::common::{copy_folder, refused, satgs, succeeds, text};
use serde_json::Value;
use std::path::Path;

pub const FOLDERS: &[&str] = &[
    "align_geoid_crs",
    "align_smooth_reference",
    "dem_in_feet",
    "eval_web_mercator",
    "gcp-swapped",
    "gcp_above_sea_level",
    "georef-one-flight-line",
    "mesh-eval-large-triangles",
    "mesh-glb-in-map-coordinates",
    "predict-points-elsewhere",
    "xyz_holes",
];

fn name(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// What `satgs --json …` prints, and its warnings.
fn json(args: &[&str]) -> (Value, String) {
    let out = succeeds(&[&["--json"], args].concat());
    (serde_json::from_slice(&out.stdout).unwrap(), text(&out))
}

/// The angle between the rotations of two georeferences.
fn turn_deg(a: &Value, b: &Value) -> f64 {
    let entry = |g: &Value, i: usize| g["rotation"][i / 3][i % 3].as_f64().unwrap();
    let trace: f64 = (0..9).map(|i| entry(a, i) * entry(b, i)).sum();
    (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees()
}

#[test]
fn one_flight_line_is_completed_by_nadir_views_or_refused() {
    let Some(scene) = input("georef-one-flight-line") else { return };
    let info = |list: &str| json(&["info", name(&scene), "--georef", name(&scene.join(list))]);
    let (exact, told) = info("geo-exact.txt");
    let fit = &exact["georeference"]["fit"];
    assert!(!told.contains("vertical"), "{told}");
    assert!(fit["prior"].is_null() && fit["redundancy"] == 17, "{fit}");
    let (cm, told) = info("geo-cm.txt");
    assert!(told.contains("do not determine the vertical") && told.contains("straight down"), "{told}");
    // The photographs look straight down to 1.5 degrees.
    let turned = turn_deg(&exact["georeference"], &cm["georeference"]);
    assert!(turned < 2.0, "{turned}");
    let list = scene.join("geo-gps.txt");
    refused(&["info", name(&scene), "--georef", name(&list)], 2, &["heading", "RMS", "redundancy"]);
}

/// Copies the scene of a flight line with other positions.
fn with_positions(change: impl Fn(usize, &mut [f64; 3])) -> Option<(tempfile::TempDir, String)> {
    let scene = input("georef-one-flight-line")?;
    let folder = tempfile::tempdir().unwrap();
    let mut list = String::new();
    for (i, line) in std::fs::read_to_string(scene.join("geo-exact.txt")).unwrap().lines().enumerate() {
        let words: Vec<&str> = line.split(' ').collect();
        if let [image, x, y, z] = words.as_slice() {
            let mut position = [x, y, z].map(|v| v.parse().unwrap());
            change(i - 1, &mut position);
            let [x, y, z] = position;
            list += &format!("{image} {x} {y} {z}\n");
        } else {
            list += &format!("{line}\n");
        }
    }
    let file = folder.path().join("geo.txt");
    std::fs::write(&file, list).unwrap();
    let file = name(&file).to_owned();
    Some((folder, file))
}

#[test]
fn positions_without_a_fix_and_gross_errors_are_named_and_left_out() {
    let Some(scene) = input("georef-one-flight-line") else { return };
    let Some((_kept, list)) = with_positions(|i, p| match i {
        2 => *p = [0.0; 3],
        5 => p[2] += 300.0,
        _ => {}
    }) else {
        return;
    };
    let (info, told) = json(&["info", name(&scene), "--georef", &list]);
    let fit = &info["georeference"]["fit"];
    assert_eq!(
        (fit["points"].as_u64(), fit["without_fix"][0].as_str()),
        (Some(6), Some("IMG_002.jpg")),
        "{fit}"
    );
    assert_eq!(fit["left_out"][0][0], "IMG_005.jpg", "{fit}");
    assert!(told.contains("IMG_005.jpg") && told.contains("IMG_002.jpg"), "{told}");
    assert_eq!(info["georeference"]["grid"]["epsg"], 32631);
    // Two names that are exchanged.
    let exact = std::fs::read_to_string(scene.join("geo-exact.txt")).unwrap();
    let swapped = exact.replace("IMG_001", "IMG_X").replace("IMG_006", "IMG_001").replace("IMG_X", "IMG_006");
    std::fs::write(&list, swapped).unwrap();
    let (info, _) = json(&["info", name(&scene), "--georef", &list]);
    let left_out = info["georeference"]["fit"]["left_out"].to_string();
    assert!(left_out.contains("IMG_001") && left_out.contains("IMG_006"), "{left_out}");
}

#[test]
fn places_of_other_images_are_refused_and_web_mercator_is_converted() {
    let Some(scene) = input("georef-one-flight-line") else { return };
    let shuffled = |i: usize, p: &mut [f64; 3]| {
        let k = [3.0, 7.0, 0.0, 5.0, 1.0, 6.0, 2.0, 4.0][i];
        *p = [448_221.0 + 12.0 * k, 5_412_345.0 + k * k % 5.0, 220.0];
    };
    let Some((_kept, list)) = with_positions(shuffled) else { return };
    refused(&["info", name(&scene), "--georef", &list], 2, &["does not determine where the scene lies"]);
    let to = satgs::frame::Transform::new(32631, 3857).unwrap();
    let Some((_kept, list)) = with_positions(|_, p| (p[0], p[1]) = to.convert(p[0], p[1])) else { return };
    let text = std::fs::read_to_string(&list).unwrap().replace("EPSG:32631", "EPSG:3857");
    std::fs::write(&list, text).unwrap();
    let (info, _) = json(&["info", name(&scene), "--georef", &list]);
    let georeference = &info["georeference"];
    assert_eq!(georeference["grid"]["epsg"], 32631);
    assert!(georeference["fit"]["rms_m"].as_f64().unwrap() < 0.01, "{georeference}");
}

#[test]
fn a_run_says_what_info_says() {
    let Some(scene) = input("georef-one-flight-line") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (run, list) = (folder.path().join("run"), scene.join("geo-cm.txt"));
    let out = satgs(&["run", name(&scene), "-o", name(&run), "--georef", name(&list), "--iterations", "1"]);
    let told = text(&out);
    for says in ["8 camera positions fitted with an RMS of", "worst `IMG_", "do not determine the vertical"] {
        assert!(told.contains(says), "`{says}` in {told}");
    }
}

#[test]
fn points_that_no_camera_sees_or_far_from_those_of_the_scene_are_refused() {
    let Some(scene) = input("predict-points-elsewhere") else { return };
    let folder = tempfile::tempdir().unwrap();
    let predict = |points: &Path, out: &str, more: &[&'static str]| {
        let out = name(&folder.path().join(out)).to_owned();
        let args =
            ["predict", name(&scene), "-o", &out, "--points", name(points), "--without-network", "flat"];
        satgs(&[&args, more].concat())
    };
    let aside = predict(&scene.join("points-100-aside.ply"), "aside", &[]);
    assert_eq!(aside.status.code(), Some(2));
    assert!(text(&aside).contains("they lie 97.26 units from the points"), "{}", text(&aside));
    let right = predict(&scene.join("points-right.ply"), "right", &[]);
    assert!(right.status.success() && !text(&right).contains("do not fit"), "{}", text(&right));
    // The right points, raised by a twentieth of their extent.
    let ply = std::fs::read_to_string(scene.join("points-right.ply")).unwrap();
    let (head, body) = ply.split_once("end_header\n").unwrap();
    let raised = body.lines().map(|line| {
        let [x, y, z] =
            <[f64; 3]>::try_from(line.split(' ').map(|v| v.parse().unwrap()).collect::<Vec<f64>>()).unwrap();
        format!("{x} {y} {}\n", z + 6.0)
    });
    let high = folder.path().join("high.ply");
    std::fs::write(&high, format!("{head}end_header\n{}", raised.collect::<String>())).unwrap();
    let refused = predict(&high, "high", &[]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(text(&refused).contains("do not belong to the cameras"), "{}", text(&refused));
}

/// The photographs of a small scene from the air, as a COLMAP model with tracks.
fn from_the_air(folder: &Path) -> std::path::PathBuf {
    let scene = folder.join("air");
    succeeds(&["simulate", name(&scene), "--aerial", "--size", "96", "--views", "8", "-q"]);
    scene
}

#[test]
fn images_of_another_scene_and_points_that_were_moved_alone_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let right = from_the_air(folder.path());
    let run = |scene: &Path, out: &str| {
        let out = name(&folder.path().join(out)).to_owned();
        satgs(&["run", name(scene), "-o", &out, "--iterations", "1"])
    };
    let told = run(&right, "right");
    assert!(told.status.success() && !text(&told).contains("correlation"), "{}", text(&told));
    // Images in the reverse order.
    let other = folder.path().join("other");
    copy_folder(&right, &other);
    let mut images: Vec<_> =
        std::fs::read_dir(other.join("images")).unwrap().map(|e| e.unwrap().path()).collect();
    images.sort();
    let bytes: Vec<_> = images.iter().map(|path| std::fs::read(path).unwrap()).collect();
    images.iter().zip(bytes.iter().rev()).for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
    let told = run(&other, "run-of-other");
    println!("{}", text(&told));
    // Points that were moved without the cameras.
    let model = satgs::perspective::colmap::read(&right.join("sparse/0")).unwrap();
    println!("{} points, {:?}", model.points.len(), model.reprojection());
    assert!(text(&told).contains("correlation"), "{}", text(&told));
}

#[test]
fn the_size_of_triangles_does_not_change_the_scores_of_a_mesh() {
    let Some(folder) = input("mesh-eval-large-triangles") else { return };
    let (fine, coarse) = (folder.join("box-fine.obj"), folder.join("box-12-triangles.obj"));
    for [a, b] in [[&fine, &coarse], [&coarse, &fine]] {
        let (scores, _) = json(&["mesh-eval", name(a), name(b), "--threshold", "0.2"]);
        assert!(scores["accuracy_m"].as_f64().unwrap() < 1e-6, "{scores}");
        assert_eq!((scores["precision"].as_f64(), scores["f1"].as_f64()), (Some(1.0), Some(1.0)));
    }
}

#[test]
fn a_glb_in_map_coordinates_keeps_its_millimetres() {
    let Some(scene) = input("mesh-glb-in-map-coordinates") else { return };
    let folder = tempfile::tempdir().unwrap();
    let [glb, ply] = ["m.glb", "m.ply"].map(|f| folder.path().join(f));
    for path in [&glb, &ply] {
        succeeds(&["mesh", name(&scene), "-o", name(path), "--voxel", "0.1", "--depth-max", "10"]);
    }
    let bytes = std::fs::read(&glb).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let (low, high) = (&document["accessors"][0]["min"], &document["accessors"][0]["max"]);
    for k in 0..3 {
        assert!(
            low[k].as_f64().unwrap().abs() < 100.0 && high[k].as_f64().unwrap().abs() < 100.0,
            "{low} {high}"
        );
    }
    let node = &document["nodes"][0];
    let far = |v: &Value| v.as_f64().unwrap().abs() > 400_000.0;
    assert!(node["translation"].as_array().unwrap().iter().any(far), "{node}");
}

#[test]
fn a_reference_without_buildings_does_not_move_a_run_where_it_says_nothing() {
    let Some(folder) = input("align_smooth_reference") else { return };
    let out = tempfile::tempdir().unwrap();
    let run = out.path().join("run");
    succeeds(&["run", name(&folder.join("scene")), "-o", name(&run), "--iterations", "20"]);
    let (aligned, told) = json(&["align", name(&run), "--to", name(&folder.join("dtm.tif"))]);
    println!("{aligned} {told}");
    let found = &aligned["alignment"];
    let shift = ["east_m", "north_m"].map(|k| found["shift"][k].as_f64().unwrap());
    let off = (shift[0] - 3.7).hypot(shift[1] + 2.7);
    match found["directions"].as_u64() {
        Some(0) => assert!(shift == [0.0; 2] && told.contains("is not determined"), "{found} {told}"),
        Some(1) => assert!(off < 6.0 && told.contains("one direction"), "{found} {told}"),
        _ => assert!(off < 1.5, "{found}"),
    }
}

#[test]
fn control_above_the_sea_is_warned_of() {
    let Some(folder) = input("gcp_above_sea_level") else { return };
    let out = tempfile::tempdir().unwrap();
    let scene = folder.join("scene");
    let told = |control: &str, run: &str| {
        let run = out.path().join(run);
        text(&succeeds(&["ba", name(&scene), "-o", name(&run), "--gcps", name(&folder.join(control))]))
    };
    let wrong = told("control.csv", "wrong");
    assert!(wrong.contains("about the height of the geoid here") && wrong.contains("redundancy"), "{wrong}");
    let right = told("control_right.csv", "right");
    assert!(!right.contains("geoid") && right.contains("worst `line"), "{right}");
    let run = out.path().join("right");
    let aligned = text(&succeeds(&["align", name(&run), "--to", name(&folder.join("control.csv"))]));
    assert!(aligned.contains("about the height of the geoid here"), "{aligned}");
    // Another datum: 120 m east.
    let control = std::fs::read_to_string(folder.join("control_right.csv")).unwrap();
    let east = |line: &str| match line.split_once(',') {
        Some((lon, rest)) if lon.parse::<f64>().is_ok() => {
            format!("{},{rest}\n", lon.parse::<f64>().unwrap() + 0.00148)
        }
        _ => format!("{line}\n"),
    };
    let elsewhere = out.path().join("elsewhere.csv");
    std::fs::write(&elsewhere, control.lines().map(east).collect::<String>()).unwrap();
    let out = satgs(&["ba", name(&scene), "-o", name(&out.path().join("away")), "--gcps", name(&elsewhere)]);
    assert!(text(&out).contains("more than cameras of satellites are off"), "{}", text(&out));
}

#[test]
fn swapped_control_and_control_outside_of_images_is_refused() {
    let Some(folder) = input("gcp-swapped") else { return };
    let out = tempfile::tempdir().unwrap();
    for (control, says) in [
        ("swapped.csv", "lon and lat are swapped"),
        ("outside.csv", "is outside of"),
        ("semicolon.csv", "semicolons"),
    ] {
        let run = out.path().join(control);
        refused(&["ba", name(&folder), "-o", name(&run), "--gcps", name(&folder.join(control))], 2, &[says]);
    }
}

#[test]
fn shifts_are_metres_on_the_ground_in_any_map() {
    let Some(folder) = input("eval_web_mercator") else { return };
    let scores =
        |truth: &str| json(&["dsm-eval", name(&folder.join("dsm.tif")), name(&folder.join(truth))]).0;
    let (utm, web) = (scores("truth_utm.tif"), scores("truth_3857.tif"));
    let xyz = |scores: &Value, key: &str| scores["registered_scores"][2][key].as_f64().unwrap();
    for (key, right) in [("east_m", 3.9), ("north_m", -2.5)] {
        assert!((xyz(&utm, key) - right).abs() < 0.1, "{utm}");
        assert!((xyz(&web, key) - right).abs() < 0.2, "{} {}", xyz(&utm, key), xyz(&web, key));
        let sigma = xyz(&utm, &key.replace("_m", "_sigma_m"));
        assert!(sigma > 0.0 && sigma < 0.5, "{sigma}");
    }
    assert!((web["cell_m"].as_f64().unwrap() / web["grid"]["cell"].as_f64().unwrap() - 0.73).abs() < 0.01);
    // Shares of the slopes are those of the ground.
    let steep = |scores: &Value| {
        let parts = scores["registered_scores"][2]["breakdown"].as_array().unwrap();
        let cells = |p: &Value| p["cells"].as_f64().unwrap();
        let steep = parts.iter().find(|p| p["name"] == "slope 45 to 90°").unwrap();
        cells(steep) / parts.iter().filter(|p| p["by"] == "slope").map(cells).sum::<f64>()
    };
    println!("{} {}", steep(&utm), steep(&web));
    assert!((steep(&utm) - steep(&web)).abs() < 0.3 * steep(&utm), "{} {}", steep(&utm), steep(&web));
}

#[test]
fn holes_do_not_shift_a_surface() {
    let Some(folder) = input("xyz_holes") else { return };
    let (scores, _) = json(&["dsm-eval", name(&folder.join("p.tif")), name(&folder.join("t.tif"))]);
    let xyz = &scores["registered_scores"][2];
    for key in ["dx_cells", "dy_cells"] {
        assert!(xyz[key].as_f64().unwrap().abs() < 0.03, "{xyz}");
    }
    assert!((xyz["completeness"].as_f64().unwrap() - 0.8).abs() < 0.01, "{xyz}");
}

/// A small town with its cameras as they are.
fn town(folder: &Path) -> std::path::PathBuf {
    let town = folder.join("town");
    succeeds(&["simulate", name(&town), "--size", "256", "--views", "3", "-q"]);
    town
}

#[test]
fn references_above_a_geoid_are_converted() {
    let Some(inputs) = input("align_geoid_crs") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (town, run) = (town(folder.path()), folder.path().join("run"));
    succeeds(&["ba", name(&town), "-o", name(&run)]);
    for reference in ["ref_egm96.tif", "ref_satgs_tag.tif", "al_egm.laz"] {
        let out = satgs(&["--json", "align", name(&run), "--to", name(&inputs.join(reference))]);
        assert!(out.status.success(), "{reference}: {}", text(&out));
        let aligned: Value = serde_json::from_slice(&out.stdout).unwrap();
        let up = aligned["alignment"]["shift"]["up_m"].as_f64().unwrap();
        assert!(up.abs() < 10.0, "{reference}: {aligned}");
    }
}

#[test]
fn elevations_in_feet_are_converted() {
    let Some(inputs) = input("dem_in_feet") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (town, run) = (town(folder.path()), folder.path().join("run"));
    let dem = inputs.join("dem_ftus.tif");
    succeeds(&["ba", name(&town), "-o", name(&run), "--dem", name(&dem), "--dem-vertical", "ellipsoid"]);
}
