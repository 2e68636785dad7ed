//! `satgs export`: COLMAP projects of satellite runs, variants of splat files, and what is refused.

use crate::common;
use crate::common::satgs;
use satgs::frame::Point;
use satgs::perspective::{PerspectiveOptions, PerspectiveScene, colmap};
use satgs::pipeline::{TrainedCameras, export_colmap};
use satgs::progress::NoProgress;
use satgs::splat::ply;
use serde_json::Value;
use std::path::Path;
use std::sync::OnceLock;

/// A small run, made once.
pub(crate) fn run() -> &'static Path {
    static RUN: OnceLock<tempfile::TempDir> = OnceLock::new();
    RUN.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().to_str().unwrap();
        for args in [vec!["ba", "data/town", "-o", run], vec!["train", run, "--iterations", "20"]] {
            let made = satgs(&args);
            assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        }
        folder
    })
    .path()
}

/// Exports with `--json` and returns the summary.
fn export(args: &[&str]) -> Value {
    let output = satgs(&[&["export", run().to_str().unwrap(), "--json"], args].concat());
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_colmap_project_sees_the_ground_where_the_cameras_of_the_run_do() {
    let folder = tempfile::tempdir().unwrap();
    let project = folder.path().join("new/project");
    let summary = export(&["--colmap", project.to_str().unwrap()]);
    let cameras = TrainedCameras::read(run()).unwrap().setup;
    let views = summary["views"].as_array().unwrap();
    assert_eq!(views.len(), cameras.views.len());
    for view in views {
        assert!(view["rms_px"].as_f64().unwrap() < 0.1 && view["max_px"].as_f64().unwrap() < 0.5, "{view}");
    }
    let model = colmap::read(&project.join("sparse/0")).unwrap();
    assert_eq!(model.images.len(), views.len());
    assert!(model.points.len() > 20 && summary["points"] == model.points.len());
    assert!(model.reprojection().unwrap().mean_px < 0.5, "{:?}", model.reprojection());
    // Points are in the site frame, inside of the area and its surroundings, and have the colours of the images.
    let (west, _, east, _) = cameras.area;
    assert!(model.points.iter().all(|p| p.position[0] > 2.0 * west && p.position[0] < 2.0 * east));
    assert!(model.points.iter().any(|p| p.rgb.iter().any(|v| *v != p.rgb[0])));
    for (image, camera) in model.images.iter().zip(&model.cameras) {
        let png = image::open(project.join("images").join(&image.name)).unwrap();
        assert_eq!((u64::from(png.width()), u64::from(png.height())), (camera.width, camera.height));
    }
    let georef: Value = serde_json::from_slice(&std::fs::read(project.join("georef.json")).unwrap()).unwrap();
    assert_eq!(georef["epsg"], cameras.site.epsg);
    assert_eq!(georef["origin"]["easting_m"], cameras.site.origin.x());
    // Nothing else lies beside the project.
    assert_eq!(std::fs::read_dir(folder.path().join("new")).unwrap().count(), 1);
}

#[test]
fn resampled_images_show_what_the_images_of_the_views_show() {
    let folder = tempfile::tempdir().unwrap();
    export_colmap(run(), folder.path(), colmap::Format::Binary, false, &NoProgress).unwrap();
    let model = colmap::read(&folder.path().join("sparse/0")).unwrap();
    let setup = TrainedCameras::read(run()).unwrap().setup;
    let scene = satgs::pipeline::read_scene(run()).unwrap();
    for (image, camera) in model.images.iter().zip(&model.cameras) {
        let name = image.name.trim_end_matches(".png");
        let view = setup.views.iter().find(|v| v.name == name).unwrap();
        let bands = scene.views.iter().find(|v| v.name == name).unwrap().read_colors().unwrap();
        let png = image::open(folder.path().join("images").join(&image.name)).unwrap().to_rgb8();
        let lens = camera.lens().unwrap();
        let [w, x, y, z] = image.rotation;
        let rotation = glam::DQuat::from_xyzw(x, y, z, w);
        let (mut differences, mut n) = (0.0, 0);
        for i in 0..400 {
            let p = [f64::from(i % 20) * 3.0 - 30.0, f64::from(i / 20) * 3.0 - 30.0, 2.0];
            let c = rotation * glam::DVec3::from_array(p) + glam::DVec3::from_array(image.translation);
            let px = lens.project(c).unwrap();
            let seen = view.camera.project(Point::new(p[0], p[1], p[2]));
            let (col, row) = (px.col.round(), px.row.round());
            let expected = bands[0].bilinear(seen.col, seen.row);
            if col < 0.0
                || row < 0.0
                || col >= f64::from(png.width())
                || row >= f64::from(png.height())
                || expected.is_nan()
            {
                continue;
            }
            differences +=
                (f64::from(png.get_pixel(col as u32, row as u32).0[0]) / 255.0 - f64::from(expected)).abs();
            n += 1;
        }
        // Half a pixel of rounding on a textured town; a shift of 2 pixels gives three times as much.
        assert!(
            n > 100 && differences / f64::from(n) < 0.04,
            "{name}: {} of {n}",
            differences / f64::from(n)
        );
    }
}

#[test]
fn the_same_run_gives_the_same_project_and_text_holds_what_binary_holds() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    export(&["--colmap", &path("a"), "--threads", "1"]);
    export(&["--colmap", &path("b"), "--threads", "3"]);
    let contents =
        |name: &str| common::files(&folder.path().join(name)).into_iter().map(|f| f.1).collect::<Vec<_>>();
    assert_eq!(contents("a"), contents("b"));
    export(&["--colmap", &path("c"), "--format", "text"]);
    let model = |name: &str| colmap::read(&folder.path().join(name).join("sparse/0")).unwrap();
    let (binary, text) = (model("a"), model("c"));
    assert_eq!((binary.cameras.len(), binary.points.len()), (text.cameras.len(), text.points.len()));
    assert_eq!(binary.images[0].name, text.images[0].name);
    // What an earlier export wrote is replaced, other files stay.
    std::fs::write(folder.path().join("a/notes.txt"), "mine").unwrap();
    std::fs::write(folder.path().join("a/images/old.png"), "").unwrap();
    export(&["--colmap", &path("a"), "--format", "text", "--overwrite"]);
    assert!(folder.path().join("a/notes.txt").exists() && !folder.path().join("a/images/old.png").exists());
    assert!(folder.path().join("a/sparse/0/images.txt").exists());
    assert!(!folder.path().join("a/sparse/0/images.bin").exists());
}

#[test]
fn a_perspective_run_is_exported_as_it_was_trained() {
    let folder = tempfile::tempdir().unwrap();
    common::photographs::make_run(folder.path());
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let exported = satgs(&["export", &path("run"), "--colmap", &path("project")]);
    let said = String::from_utf8_lossy(&exported.stdout).into_owned();
    assert!(exported.status.success() && said.contains("3 views, 400 points"), "{said}");
    let options = PerspectiveOptions::default();
    let read = |name: &str| PerspectiveScene::read(&folder.path().join(name), &options).unwrap();
    let (before, after) = (read("scene"), read("project"));
    assert_eq!(before.points, after.points);
    for (a, b) in before.views.iter().zip(&after.views) {
        assert_eq!((&a.name, a.camera.size, a.camera.focal), (&b.name, b.camera.size, b.camera.focal));
        assert_eq!(a.camera.principal, b.camera.principal);
        assert!(a.camera.center.distance(b.camera.center) < 1e-9);
        assert_eq!(a.read_image().unwrap(), b.read_image().unwrap());
    }
    assert!(!folder.path().join("project/georef.json").exists());

    let full = path("full.ply");
    assert!(satgs(&["export", &path("run"), "--ply", &full]).status.success());
    let own = ply::read(&folder.path().join("run/splats.ply")).unwrap();
    assert_eq!(ply::read(Path::new(&full)).unwrap(), own);
    let turned = satgs(&["export", &path("run"), "--ply", &path("turned.ply"), "--variant", "y-down"]);
    assert!(turned.status.success(), "{}", String::from_utf8_lossy(&turned.stderr));
    let turned = ply::read(Path::new(&path("turned.ply"))).unwrap();
    let [x, y, z] = own.position[7];
    assert_eq!((turned.position[7], turned.f_rest.len()), ([x, -z, y], own.len()));

    std::fs::remove_file(folder.path().join("scene/images/1.png")).unwrap();
    let gone = satgs(&["export", &path("run"), "--colmap", &path("other")]);
    let said = String::from_utf8_lossy(&gone.stderr).into_owned();
    assert!(!gone.status.success() && said.contains('1') && !Path::new(&path("other")).exists(), "{said}");

    // Cameras of a satellite run in the folder of a perspective one.
    std::fs::copy(run().join("cameras.json"), folder.path().join("run/cameras.json")).unwrap();
    let mixed = satgs(&["export", &path("run"), "--colmap", &path("other")]);
    let said = String::from_utf8_lossy(&mixed.stderr).into_owned();
    assert!(mixed.status.code() == Some(2) && said.contains("run/cameras.json"), "{said}");
}

#[test]
fn an_adjusted_run_needs_no_training() {
    let folder = tempfile::tempdir().unwrap();
    let (adjusted, project) = (folder.path().join("run"), folder.path().join("project"));
    let (adjusted, project) = (adjusted.to_str().unwrap(), project.to_str().unwrap());
    assert!(satgs(&["ba", "data/town", "-o", adjusted]).status.success());
    let exported = satgs(&["export", adjusted, "--colmap", project]);
    let said = String::from_utf8_lossy(&exported.stdout).into_owned();
    assert!(exported.status.success() && said.contains("3 views"), "{said}");
    let refused = satgs(&["export", adjusted, "--ply", &format!("{project}.ply")]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(2) && said.contains("satgs train RUN"), "{said}");
}

#[test]
fn variants_of_splat_files_hold_the_splats_of_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let own = ply::read(&run().join("splats.ply")).unwrap();
    let summary = export(&["--ply", &path("full.ply")]);
    assert_eq!(summary["splats"], own.len());
    let full = ply::read(Path::new(&path("full.ply"))).unwrap();
    assert_eq!(full.position, own.position);
    export(&["--ply", &path("down.ply"), "--variant", "y-down"]);
    let down = ply::read(Path::new(&path("down.ply"))).unwrap();
    let [x, y, z] = own.position[7];
    assert_eq!(down.position[7], [x, -z, y]);
    let georef: Value = serde_json::from_slice(&std::fs::read(path("down.georef.json")).unwrap()).unwrap();
    assert_eq!(georef["axes"], serde_json::json!(["east", "down", "north"]));
}

#[test]
fn what_cannot_be_exported_is_refused_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let run = run().to_str().unwrap();
    std::fs::create_dir(path("full")).unwrap();
    std::fs::write(path("full/file"), "").unwrap();
    std::fs::write(path("splats.ply"), "old").unwrap();
    std::fs::create_dir(path("empty")).unwrap();
    // A run whose scene and cameras are of different views.
    std::fs::create_dir(path("mixed")).unwrap();
    for name in ["ba", "scene.json"] {
        let copied =
            std::process::Command::new("cp").args(["-r", &format!("{run}/{name}"), &path("mixed")]).status();
        assert!(copied.unwrap().success());
    }
    let cameras = std::fs::read_to_string(format!("{run}/cameras.json")).unwrap();
    std::fs::write(path("mixed/cameras.json"), cameras.replace("VIEW_02", "OTHER")).unwrap();
    let new = path("new");
    for (args, says) in [
        (vec!["export", run], "--colmap"),
        (vec!["export", run, "--colmap", &new, "--ply", "x.ply"], "cannot be used with"),
        (vec!["export", &path("empty"), "--colmap", &new], "satgs ba SCENE -o RUN"),
        (vec!["export", &path("empty"), "--ply", &path("x.ply")], "satgs train RUN"),
        (vec!["export", &path("nowhere"), "--colmap", &new], "scene.json"),
        (vec!["export", &path("mixed"), "--colmap", &new], "has no view `OTHER`"),
        (vec!["export", run, "--colmap", &path("full")], "is not empty"),
        (vec!["export", run, "--ply", &path("splats.ply")], "exists"),
        (vec!["export", run, "--ply", &format!("{run}/splats.ply"), "--overwrite"], "the run's own splats"),
        (vec!["export", run, "--ply", &path("splats.txt")], ".ply"),
    ] {
        let output = satgs(&args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(says) && output.status.code() == Some(2), "{args:?}: {said}");
    }
    for (args, says) in [
        (["export", run, "--colmap", &path("splats.ply")], "splats.ply` failed"),
        (["export", run, "--ply", &path("full/file/x.ply")], "is not a folder"),
    ] {
        let output = satgs(&args);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(says) && output.status.code() == Some(1), "{args:?}: {said}");
    }
    assert_eq!(std::fs::read_to_string(path("splats.ply")).unwrap(), "old");
    // Nothing half is left behind.
    assert!(!Path::new(&new).exists());
    let hidden = std::fs::read_dir(folder.path())
        .unwrap()
        .filter(|e| e.as_ref().unwrap().file_name().to_string_lossy().starts_with(".satgs-"));
    assert_eq!(hidden.count(), 0);
}
