//! `satgs simulate --room` and `--aerial` write scenes that the perspective reader takes, and a truth that fits them.
use crate::common;
use crate::common::satgs;
use glam::DVec3;
use satgs::frame::Pixel;
use satgs::io::NpyArray;
use satgs::mesh::TriangleMesh;
use satgs::perspective::colmap;
use satgs::perspective::{PerspectiveOptions, PerspectiveScene, PerspectiveView, TestViews};
use satgs::prior::{DepthKind, NormalAxes, PriorFolder};
use satgs::progress::NoProgress;
use satgs::scene::Role;
use satgs::simulate::{
    AerialOptions, RoomOptions, SimulateOptions, TestSetSummary, simulate, simulate_aerial, simulate_room,
};
use std::collections::BTreeMap;
use std::path::Path;

/// Columns and rows of the images.
const SIZE: usize = 64;

fn room(out: &Path, overwrite: bool) -> TestSetSummary {
    let options = RoomOptions { views: 8, size_px: SIZE, overwrite, ..RoomOptions::default() };
    simulate_room(out, &options, &NoProgress).unwrap()
}

fn aerial(out: &Path, overwrite: bool) -> TestSetSummary {
    let options = AerialOptions { views: 8, size_px: SIZE, overwrite, ..AerialOptions::default() };
    simulate_aerial(out, &options, &NoProgress).unwrap()
}

fn array(out: &Path, folder: &str, view: &str) -> NpyArray {
    NpyArray::read(&out.join(folder).join(format!("{view}.npy"))).unwrap()
}

/// The points project into their images where they were found, at the depths of the maps. `noise_m` is the root mean square
/// of their errors.
fn points_agree_with_depths(out: &Path, noise_m: f64, expected_points: usize) {
    let scene = PerspectiveScene::read(out, &PerspectiveOptions::default()).unwrap();
    assert_eq!((scene.views.len(), scene.points.len()), (8, expected_points));
    let model = colmap::read(&out.join("sparse/0")).unwrap();
    let lens = model.cameras[0].lens().unwrap();
    let points: BTreeMap<u64, _> = model.points.iter().map(|p| (p.id, p)).collect();
    assert!(model.points.iter().all(|p| p.track.len() >= 3 && p.error < 5.0));
    let (mut near, mut of_all) = (0, 0);
    for image in &model.images {
        let view = image.name.strip_suffix(".png").unwrap();
        let depths = array(out, "truth/depths", view);
        assert_eq!(depths.shape, [SIZE, SIZE]);
        let [w, x, y, z] = image.rotation;
        let rotation = glam::DQuat::from_xyzw(x, y, z, w);
        for (k, found) in image.observations.iter().enumerate() {
            let point = points[&found.point.unwrap()];
            assert!(point.track.contains(&(image.id, k as u32)));
            let there = rotation * DVec3::from_array(point.position) + DVec3::from_array(image.translation);
            let px = lens.project(there).unwrap();
            // Errors of points and of observations, each at most about four times its standard deviation.
            let reach_px = 4.0 * (0.3 + noise_m * lens.focal.x / there.z);
            assert!((px.col + 0.5 - found.x).hypot(px.row + 0.5 - found.y) < 1.5 * reach_px);
            let at = |col: f64, row: f64| {
                let inside = |v: f64| (v.round() as usize).min(SIZE - 1);
                f64::from(depths.values[inside(row) * SIZE + inside(col)])
            };
            // The surface may be steep within a pixel: the depths around the place hold that of the point between them.
            let around = [(-0.7, -0.7), (0.7, -0.7), (-0.7, 0.7), (0.7, 0.7), (0.0, 0.0)]
                .map(|(u, v)| at((px.col + u).max(0.0), (px.row + v).max(0.0)));
            let low = around.iter().copied().fold(f64::INFINITY, f64::min) - 4.0 * noise_m;
            let high = around.iter().copied().fold(0.0, f64::max) + 4.0 * noise_m;
            of_all += 1;
            near += usize::from((low..=high).contains(&there.z));
        }
    }
    assert!(f64::from(near as u32) > 0.98 * f64::from(of_all as u32), "{near} of {of_all}");
}

/// Normals are unit vectors towards the camera, and say how depths change from pixel to pixel where surfaces are even.
fn normals_agree_with_depths(out: &Path, view: &str, camera: &PerspectiveView, least_share: f64) {
    let (depths, normals) = (array(out, "truth/depths", view), array(out, "truth/normals", view));
    assert_eq!(normals.shape, [SIZE, SIZE, 3]);
    let ray = |col: usize, row: usize| {
        // The ray is in axes of the scene.
        let along = DVec3::from_array(camera.camera.ray(Pixel::new(col as f64, row as f64)));
        let in_camera = camera.camera.cam_from_site * along;
        in_camera / in_camera.z
    };
    let normal = |k: usize| DVec3::from_array([0, 1, 2].map(|b| f64::from(normals.values[3 * k + b])));
    let (mut same, mut of_all) = (0, 0);
    for row in 0..SIZE {
        for col in 0..SIZE - 1 {
            let k = row * SIZE + col;
            let n = normal(k);
            assert!((n.length() - 1.0).abs() < 1e-5 && n.dot(ray(col, row)) < 0.0, "{n}");
            let place = |k: usize, col: usize| ray(col, row) * f64::from(depths.values[k]);
            let step = place(k + 1, col + 1) - place(k, col);
            let is_even = normal(k + 1).dot(n) > 0.9999;
            of_all += usize::from(is_even);
            same += usize::from(is_even && n.dot(step).abs() < 0.02 * step.length());
        }
    }
    assert!(of_all > 500 && same as f64 > least_share * of_all as f64, "{same} of {of_all}");
}

#[test]
fn a_room_is_read_as_a_scene_and_its_truth_fits() {
    let folder = tempfile::tempdir().unwrap();
    let summary = room(folder.path(), false);
    assert_eq!((summary.points, summary.views.len()), (3000, 8));
    points_agree_with_depths(folder.path(), 0.003, 3000);
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    for view in &scene.views {
        normals_agree_with_depths(folder.path(), &view.name, view, 0.95);
    }
    let mesh = TriangleMesh::read(&summary.mesh).unwrap();
    assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (summary.mesh_vertices, summary.mesh_triangles));
    let [low, high] = mesh.bounds().unwrap();
    assert_eq!((low, high), ([-2.0, -2.5, 0.0], [2.0, 2.5, 2.5]));
}

#[test]
fn priors_are_found_by_the_names_of_the_views() {
    let folder = tempfile::tempdir().unwrap();
    room(folder.path(), false);
    let scene = PerspectiveScene::read(folder.path(), &PerspectiveOptions::default()).unwrap();
    let [depths, normals] = ["depths", "normals"]
        .map(|kind| PriorFolder::open(&folder.path().join("priors").join(kind)).unwrap());
    assert_eq!(depths.description().kind, Some(DepthKind::Disparity));
    for view in &scene.views {
        let file = depths.file(view).unwrap();
        assert!(depths.depth(&file, view, DepthKind::Disparity).is_ok());
        let file = normals.file(view).unwrap();
        assert!(normals.normal(&file, view, &NormalAxes::USUAL).is_ok());
    }
}

#[test]
fn photographs_from_the_air_are_read_with_their_lists_and_their_truth_fits() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let summary = aerial(out, false);
    points_agree_with_depths(out, 0.3, 300);
    let list = summary.test_list.clone().unwrap();
    let options = PerspectiveOptions { test_views: TestViews::List(list), ..PerspectiveOptions::default() };
    let scene = PerspectiveScene::read(out, &options).unwrap();
    let training: Vec<_> =
        scene.views.iter().filter(|v| v.role == Role::Train).map(|v| format!("{}.png\n", v.name)).collect();
    assert_eq!(training.concat(), std::fs::read_to_string(out.join("train.txt")).unwrap());
    assert_eq!(training.len(), 3);
    for (view, simulated) in scene.views.iter().zip(&summary.views) {
        assert_eq!((&view.name, view.role), (&simulated.name, simulated.role));
        let [near, far] = simulated.depths_m;
        assert!(near > 520.0 && far < 950.0, "{near} {far}");
        normals_agree_with_depths(out, &view.name, view, 0.9);
    }
    let mesh = TriangleMesh::read(&summary.mesh).unwrap();
    assert!(mesh.bounds().unwrap()[1][2] > 20.0, "the tower is part of the mesh");
}

#[test]
fn the_same_options_give_the_same_bytes_and_another_set_leaves_no_files_of_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    let run = |threads: usize, make: fn(&Path, bool) -> TestSetSummary| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| make(&out, true));
        common::files(&out)
    };
    for make in [room, aerial] {
        let first = run(1, make);
        assert!(first == run(3, make), "bytes differ");
    }
    // Images and four maps of each view; the model; mesh and disparities; the kind of the priors; both lists.
    assert_eq!(common::files(&out).len(), 8 * 5 + 3 + 2 + 1 + 2);
    assert_eq!(run(2, room).len(), 8 * 5 + 3 + 2 + 1);
}

#[test]
fn photographs_and_models_of_others_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    for file in ["images/0001.png", "images/0099.png", "sparse/0/points3D.txt", "train.txt"] {
        let path = folder.path().join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "made by a camera").unwrap();
    }
    let before = common::files(folder.path());
    let options = RoomOptions { views: 6, size_px: 32, ..RoomOptions::default() };
    assert!(simulate_room(folder.path(), &options, &NoProgress).is_err());
    assert!(common::files(folder.path()) == before);
    let satellite = SimulateOptions { views: 3, size_px: 64, overwrite: true, ..SimulateOptions::default() };
    simulate(folder.path(), &satellite, &NoProgress).unwrap();
    let after = common::files(folder.path());
    assert!(before.iter().all(|(path, bytes)| after.get(path) == Some(bytes)));
}

#[test]
fn options_of_satellite_images_are_refused_for_photographs() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    let refused = |options: &[&str], named: &str| {
        let output = satgs(&[&["simulate", out.to_str().unwrap()], options].concat());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{options:?} {said}");
        assert!(said.contains(named), "{options:?} {said}");
        assert!(!out.exists());
    };
    for photographs in ["--room", "--aerial"] {
        refused(&[photographs, "--seasons"], "--seasons");
        refused(&[photographs, "--gsd", "0.3"], "--gsd");
        refused(&[photographs, "--cars", "2"], "--cars");
        refused(&[photographs, "--held-out", "2"], "--held-out");
        refused(&[photographs, "--views", "3"], photographs);
    }
    refused(&["--room", "--hilly"], "--hilly");
    refused(&["--room", "--aerial"], "--aerial");
}

/// Writes an aerial set in the layout of LEVIR-NVS, with its lists of views.
fn as_levir(set: &Path, out: &Path) {
    let scene = PerspectiveScene::read(set, &PerspectiveOptions::default()).unwrap();
    ["Images", "Cams", "Depths"].iter().for_each(|f| std::fs::create_dir_all(out.join(f)).unwrap());
    for (k, view) in scene.views.iter().enumerate() {
        std::fs::copy(&view.image, out.join(format!("Images/{k:03}.png"))).unwrap();
        let camera = &view.camera;
        let translation = -(camera.cam_from_site * camera.center);
        let row = |r: usize| {
            let [a, b, c] = camera.cam_from_site.row(r).to_array();
            format!("{a} {b} {c} {}\n", translation[r])
        };
        let (f, c) = (camera.focal, camera.principal);
        let text = format!(
            "extrinsic\n{}0 0 0 1\n\nintrinsic\n{} 0 {}\n0 {} {}\n0 0 1\n\n500 700\n",
            (0..3).map(row).collect::<String>(),
            f.x,
            c.x,
            f.y,
            c.y
        );
        std::fs::write(out.join(format!("Cams/{k:03}.txt")), text).unwrap();
        let depths = array(set, "truth/depths", &view.name);
        let path = out.join(format!("Depths/{k:03}.tiff"));
        let driver = gdal::DriverManager::get_driver_by_name("GTiff").unwrap();
        let file = driver.create_with_band_type::<f32, _>(&path, SIZE, SIZE, 1).unwrap();
        let mut buffer = gdal::raster::Buffer::new((SIZE, SIZE), depths.values);
        file.rasterband(1).unwrap().write((0, 0), (SIZE, SIZE), &mut buffer).unwrap();
        file.close().unwrap();
    }
    std::fs::write(out.join("view_split.txt"), "3\n0 3 6\n5\n1 2 4 5 7\n").unwrap();
}

#[test]
fn a_scene_in_the_layout_of_levir_is_trained_by_recipe_geoprop_and_scored() {
    let folder = tempfile::tempdir().unwrap();
    let [set, levir, run] = ["set", "levir", "run"].map(|name| folder.path().join(name));
    aerial(&set, false);
    as_levir(&set, &levir);
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let (run, levir) = (text(&run), text(&levir));
    let depths = format!("{levir}/Depths");
    let options =
        ["--recipe", "geoprop", "--depth-prior", &depths, "--reference-points", "--iterations", "60", "-q"];
    let output = satgs(&[&["run", &levir, "-o", &run], &options[..]].concat());
    assert!(output.status.success(), "{}", common::text(&output));
    let output = satgs(&["nvs-eval", &run, "--json"]);
    let scores: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(scores["views"].as_array().unwrap().len(), 5, "{scores}");
    assert!(scores["views"][0]["score"]["psnr_db"].as_f64().unwrap() > 15.0, "{scores}");
}
