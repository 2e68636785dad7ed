//! `satgs mesh` and `satgs mesh-eval`, through the binary: an RGB-D scene whose surface is known, a satellite run, bad input.

use crate::common;
use crate::common::{data_dir, satgs, text};
use gdal::DriverManager;
use gdal::raster::{Buffer, RasterCreationOptions};
use glam::{DMat3, DVec2, DVec3};
use satgs::frame::{Point, SiteGrid};
use satgs::io::{Grid2, write_png_rgb};
use satgs::mesh::{DepthCamera, DepthMap, FuseOptions, KeptPieces, TriangleMesh, fuse, render_depth};
use satgs::metrics::mesh_scores;
use satgs::perspective::{PerspectiveOptions, PerspectiveScene, PinholeCamera};
use satgs::pipeline::PipelineError;
use satgs::progress::NoProgress;
use serde_json::Value;
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (160, 120);
const FOCAL_PX: f64 = 150.0;

/// A ball of one metre as a mesh of meridians and parallels.
fn ball(steps: u32) -> TriangleMesh {
    let at = |i: u32, k: u32| {
        let (polar, azimuth) = (f64::from(i) / f64::from(steps), f64::from(k) / f64::from(steps));
        let ((sin, cos), (s, c)) =
            ((polar * std::f64::consts::PI).sin_cos(), (azimuth * std::f64::consts::TAU).sin_cos());
        [sin * c, sin * s, cos]
    };
    let vertices = (0..=steps).flat_map(|i| (0..=steps).map(move |k| at(i, k))).collect();
    let number = |i: u32, k: u32| i * (steps + 1) + k;
    let quads = (0..steps).flat_map(|i| (0..steps).map(move |k| (i, k)));
    let triangles = quads.flat_map(|(i, k)| {
        let [a, b, c, d] = [number(i, k), number(i + 1, k), number(i + 1, k + 1), number(i, k + 1)];
        [[a, b, c], [a, c, d]]
    });
    TriangleMesh { vertices, triangles: triangles.collect(), ..TriangleMesh::default() }
}

/// Cameras around the ball.
fn cameras(n: usize) -> Vec<PinholeCamera> {
    (0..n)
        .map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
            let (sin, cos) = (2.4 * i as f64).sin_cos();
            let level = (1.0 - z * z).sqrt();
            let center = 2.6 * DVec3::new(level * cos, level * sin, z);
            let forward = -center.normalize();
            let right = forward.cross(if forward.z.abs() > 0.9 { DVec3::X } else { DVec3::Z }).normalize();
            PinholeCamera {
                cam_from_site: DMat3::from_cols(right, forward.cross(right), forward).transpose(),
                center,
                focal: DVec2::splat(FOCAL_PX),
                principal: DVec2::new(79.5, 59.5),
                size: SIZE,
            }
        })
        .collect()
}

/// Writes a scene in the form of 7-Scenes: the ball, red, from twelve sides. Positions are divided by `unit`.
fn write_scene(folder: &Path, unit: f64) {
    std::fs::create_dir_all(folder).unwrap();
    std::fs::write(
        folder.join("camera-intrinsics.txt"),
        format!("{FOCAL_PX} 0 79.5\n0 {FOCAL_PX} 59.5\n0 0 1\n"),
    )
    .unwrap();
    for (i, camera) in cameras(12).into_iter().enumerate() {
        let file = |kind: &str| folder.join(format!("frame-{i:06}.{kind}"));
        let depth = render_depth(&ball(200), &DepthCamera::Pinhole(camera));
        // Both marks of a pixel without depth occur.
        let stored = |(i, z): (usize, &f32)| match z.is_nan() {
            true => [0, u16::MAX][i % 2],
            false => (f64::from(*z) * 1000.0 / unit).round() as u16,
        };
        write_u16(&file("depth.png"), depth.data.iter().enumerate().map(stored).collect());
        write_png_rgb(&file("color.png"), SIZE.0, SIZE.1, &[200, 40, 40].repeat(SIZE.0 * SIZE.1)).unwrap();
        let (r, c) = (camera.cam_from_site, camera.center / unit);
        let line = |k: usize| format!("{} {} {} {}\n", r.row(0)[k], r.row(1)[k], r.row(2)[k], c[k]);
        std::fs::write(file("pose.txt"), (0..3).map(line).collect::<String>() + "0 0 0 1\n").unwrap();
    }
}

fn write_u16(path: &Path, values: Vec<u16>) {
    let memory = DriverManager::get_driver_by_name("MEM").unwrap();
    let dataset = memory.create_with_band_type::<u16, _>("", SIZE.0, SIZE.1, 1).unwrap();
    dataset.rasterband(1).unwrap().write((0, 0), SIZE, &mut Buffer::new(SIZE, values)).unwrap();
    let png = DriverManager::get_driver_by_name("PNG").unwrap();
    dataset.create_copy(&png, path, &RasterCreationOptions::default()).unwrap();
}

fn succeeds(args: &[&str]) -> Value {
    let output = common::succeeds(&[args, &["--json"]].concat());
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(args: &[&str], code: i32, says: &[&str]) {
    let error = common::refused(args, code, says);
    // A hint, the values that an option may have, or the options that are missing.
    let helps = ["hint: ", ", expected ", "required arguments"];
    assert!(helps.iter().any(|help| error.contains(help)), "{args:?}: {error}");
}

struct Folder(tempfile::TempDir);

impl Folder {
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

#[test]
fn a_scene_with_depth_maps_becomes_the_mesh_that_it_shows() {
    let folder = Folder::new();
    let (scene, mesh, reference) = (folder.path("scene"), folder.path("mesh.ply"), folder.path("ball.obj"));
    write_scene(Path::new(&scene), 1.0);
    ball(300).write(Path::new(&reference)).unwrap();
    let made = succeeds(&["mesh", &scene, "-o", &mesh]);
    assert_eq!(
        (&made["depth_maps"], &made["pieces"], &made["voxel_m"]),
        (&12.into(), &1.into(), &0.02.into())
    );
    let read = TriangleMesh::read(Path::new(&mesh)).unwrap();
    assert_eq!(read.triangles.len() as u64, made["triangles"].as_u64().unwrap());
    assert!(read.colors.iter().all(|c| *c == [200, 40, 40]) && read.site.is_none());

    let errors = folder.path("errors.ply");
    let scores = succeeds(&["mesh-eval", &mesh, &reference, "--error-mesh", &errors]);
    let score = |name: &str| scores[name].as_f64().unwrap();
    assert!(score("f1") > 0.99 && score("chamfer_m") < 0.02, "{scores}");
    let errors = TriangleMesh::read(Path::new(&errors)).unwrap();
    assert!(errors.triangles == read.triangles && errors.colors != read.colors);
    the_same_in_other_formats_and_threads(&folder, &scene);
    unseen_parts_do_not_count(&folder, &scene, &read);
    another_frame_is_aligned(&folder, &scene, &reference);
    what_cannot_be_is_refused(&folder, &scene, &mesh);
}

fn the_same_in_other_formats_and_threads(folder: &Folder, scene: &str) {
    let bytes = |name: &str, threads: &str| {
        let path = folder.path(name);
        succeeds(&["mesh", scene, "-o", &path, "--voxel", "0.05", "--threads", threads]);
        std::fs::read(path).unwrap()
    };
    assert!(bytes("one.ply", "1") == bytes("two.ply", "2"));
    assert!(bytes("one.glb", "2").starts_with(b"glTF"));
    assert!(bytes("one.obj", "2").starts_with(b"v "));
}

/// A plate behind the cameras is no error of a mesh that is cut to what they see.
fn unseen_parts_do_not_count(folder: &Folder, scene: &str, mesh: &TriangleMesh) {
    let mut more = mesh.clone();
    let first = more.vertices.len() as u32;
    let plate = (0..30 * 30).map(|i| [f64::from(i % 30) * 0.1 + 4.0, f64::from(i / 30) * 0.1, 0.0]);
    more.vertices.extend(plate);
    more.colors.clear();
    more.normals.clear();
    let quads = (0..29 * 29).map(|i| first + i % 29 + i / 29 * 30);
    more.triangles.extend(quads.flat_map(|i| [[i, i + 1, i + 31], [i, i + 31, i + 30]]));
    let (path, reference) = (folder.path("more.ply"), folder.path("ball.obj"));
    more.write(Path::new(&path)).unwrap();
    let whole = succeeds(&["mesh-eval", &path, &reference]);
    let cut = succeeds(&["mesh-eval", &path, &reference, "--views", scene]);
    assert!(whole["accuracy_m"].as_f64().unwrap() > 0.1, "{whole}");
    assert!(cut["accuracy_m"].as_f64().unwrap() < 0.03 && cut["views"] == 12, "{cut}");
}

/// The same scene in a frame of other units is brought back by its cameras.
fn another_frame_is_aligned(folder: &Folder, scene: &str, reference: &str) {
    let (other, mesh) = (folder.path("other"), folder.path("other.ply"));
    write_scene(Path::new(&other), 2.0);
    succeeds(&["mesh", &other, "-o", &mesh]);
    let apart = succeeds(&["mesh-eval", &mesh, reference]);
    assert!(apart["f1"].as_f64().unwrap() < 0.1, "{apart}");
    let aligned = succeeds(&["mesh-eval", &mesh, reference, "--views", scene, "--align", &other]);
    let scale = aligned["alignment"]["scale"].as_f64().unwrap();
    assert!((scale - 2.0).abs() < 1e-6 && aligned["f1"].as_f64().unwrap() > 0.97, "{aligned}");
    refused(&["mesh-eval", &mesh, reference, "--align", &other], 2, &["--views"]);
    let few = folder.path("few");
    write_scene(Path::new(&few), 1.0);
    for i in 2..12 {
        std::fs::remove_file(folder.file(&format!("few/frame-{i:06}.pose.txt"))).unwrap();
    }
    let args = ["mesh-eval", &mesh, reference, "--views", scene, "--align", &few];
    refused(&args, 2, &["2 of its images are among those of --views"]);
}

fn what_cannot_be_is_refused(folder: &Folder, scene: &str, mesh: &str) {
    refused(&["mesh", scene, "-o", mesh], 2, &["exists", "--overwrite replaces it"]);
    let again = ["mesh", scene, "-o", mesh, "--overwrite"];
    refused(&[&again[..], &["--truncation", "0.01"]].concat(), 2, &["two voxels or more"]);
    refused(&[&again[..], &["--depth-max", "0.5"]].concat(), 2, &["12 depth maps show no surface"]);
    refused(&["mesh", &folder.path("nowhere"), "-o", &folder.path("a.ply")], 2, &["nowhere"]);
    for i in 0..12 {
        std::fs::remove_file(folder.file(&format!("scene/frame-{i:06}.depth.png"))).unwrap();
    }
    refused(&again, 2, &["frame-000000"]);
    assert!(Path::new(mesh).exists(), "a refused command has removed the mesh");
}

/// A run of a few iterations gives a georeferenced mesh with walls.
#[test]
fn a_satellite_run_becomes_a_georeferenced_mesh_with_walls() {
    let folder = Folder::new();
    let (scene, run, mesh) = (folder.path("scene"), folder.path("run"), folder.path("town.ply"));
    let quiet = |args: &[&str]| {
        let output = satgs(&[args, &["-q"]].concat());
        assert!(output.status.success(), "{args:?}: {}", text(&output));
    };
    quiet(&["simulate", &scene, "--size", "140", "--views", "6"]);
    quiet(&["ba", &scene, "-o", &run]);
    quiet(&["train", &run, "--iterations", "60"]);
    let made = succeeds(&["mesh", &run, "-o", &mesh, "--voxel", "0.6"]);
    assert_eq!(made["depth_maps"], 7, "six views and one from straight above");
    let town = TriangleMesh::read(Path::new(&mesh)).unwrap();
    let cameras: Value =
        serde_json::from_slice(&std::fs::read(folder.file("run/cameras.json")).unwrap()).unwrap();
    let site: SiteGrid = serde_json::from_value(cameras["site"].clone()).unwrap();
    assert_eq!(town.site, Some(site));
    let [low, high] = town.bounds().unwrap();
    assert!((60.0..100.0).contains(&(high[0] - low[0])) && high[2] - low[2] > 5.0, "{low:?} {high:?}");
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| DVec3::from_array(town.vertices[v as usize]));
        0.5 * (b - a).cross(c - a)
    };
    let areas: Vec<DVec3> = town.triangles.iter().map(area).collect();
    let sum = |keep: fn(&DVec3) -> bool| areas.iter().filter(|n| keep(n)).map(|n| n.length()).sum::<f64>();
    let (walls, level) = (sum(|n| n.z.abs() < 0.3 * n.length()), sum(|n| n.z > 0.9 * n.length()));
    println!("walls {walls:.0} m2, level ground and roofs {level:.0} m2");
    assert!(walls > 0.02 * level && level > 3000.0, "{walls} {level}");
    let glb = folder.path("town.glb");
    succeeds(&["mesh", &run, "-o", &glb, "--voxel", "1"]);
    assert!(folder.file("town.georef.json").exists());
    refused(
        &["mesh", &run, "-o", &folder.path("a.ply"), "--depth-max", "5"],
        2,
        &["`--depth-max` is 5", "satellites"],
    );
    refused(
        &["mesh-eval", &mesh, &mesh, "--views", &run, "--align", &run],
        2,
        &["views of satellites have no camera centres"],
    );
    let same = succeeds(&["mesh-eval", &mesh, &mesh, "--threshold", "1", "--views", &run]);
    assert_eq!((&same["f1"], &same["views"]), (&1.0.into(), &6.into()), "{same}");
}

#[test]
fn meshes_that_cannot_be_compared_are_refused_by_name_and_reason() {
    let folder = Folder::new();
    let good = folder.path("good.ply");
    ball(20).write(Path::new(&good)).unwrap();
    let put = |name: &str, content: &str| {
        std::fs::write(folder.file(name), content).unwrap();
        folder.path(name)
    };
    let header =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let cases = [
        (folder.path("missing.ply"), "missing.ply"),
        (put("empty.ply", ""), "does not begin with `ply`"),
        (put("none.obj", "# nothing\n"), "holds no triangles (0 vertices)"),
        (
            put("points.ply", &format!("{header}end_header\n0 0 0\n1 0 0\n0 1 0\n")),
            "no triangles (3 vertices)",
        ),
        (
            put("nan.ply", &format!("{header}{face}0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n")),
            "vertex 1 is not finite",
        ),
        (
            put("far.ply", &format!("{header}{face}0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")),
            "names vertices [0, 1, 7]",
        ),
        (put("cut.ply", &format!("{header}{face}0 0 0\n1 0 0\n")), "ends before the last"),
        (put("mesh.stl", ""), "is not the name of a mesh that can be read"),
    ];
    for (bad, says) in &cases {
        refused(&["mesh-eval", bad, &good], 2, &[says]);
        refused(&["mesh-eval", &good, bad], 2, &[says]);
    }
    let moved = |name: &str, epsg: u32, east: f64| {
        let site = Some(SiteGrid { epsg, origin: Point::new(500_000.0 + east, 4_000_000.0, 0.0) });
        TriangleMesh { site, ..ball(20) }.write(&folder.file(name)).unwrap();
        folder.path(name)
    };
    let (here, there) = (moved("here.ply", 32617, 0.0), moved("there.ply", 32618, 0.0));
    refused(&["mesh-eval", &here, &there], 2, &["here.ply` is in EPSG:32617", "EPSG:32618"]);
    refused(
        &["mesh-eval", &here, &moved("apart.ply", 32617, 50.0)],
        2,
        &["do not overlap: x -51.00 to -49.00"],
    );
    // Another origin on the same map is the same place.
    let mut shifted = ball(20);
    shifted.site = Some(SiteGrid { epsg: 32617, origin: Point::new(499_990.0, 4_000_000.0, 0.0) });
    shifted.vertices.iter_mut().for_each(|p| p[0] += 10.0);
    shifted.write(&folder.file("shifted.ply")).unwrap();
    let same = succeeds(&["mesh-eval", &here, &folder.path("shifted.ply")]);
    assert!(same["chamfer_m"].as_f64().unwrap() < 1e-5, "{same}");
    let output = satgs(&["mesh-eval", &here, &good]);
    assert!(output.status.success() && text(&output).contains("has no georeference"), "{}", text(&output));
    refused(&["mesh-eval", &good, &good, "--views", &folder.path("nowhere")], 2, &["nowhere"]);
    refused(&["mesh-eval", &good, &good, "--error-mesh", &good], 2, &["exists"]);
}

/// Meshes of the odd and of the even frames of a room agree (IndoorSplat, stage 1: F1 at 5 cm of 0.95 or better).
#[test]
fn two_halves_of_the_depth_maps_of_a_room_give_the_same_surface() {
    let Some(data) = data_dir() else { return };
    let scene = PerspectiveScene::read(&data.join("sevenscenes"), &PerspectiveOptions::default()).unwrap();
    let options = FuseOptions {
        voxel_m: 0.04,
        truncation_m: 0.12,
        depth_max_m: Some(5.0),
        bounds: None,
        kept: KeptPieces::LARGEST,
    };
    let half = |first: usize| {
        let views = scene.views.iter().skip(first).step_by(2);
        let map = |v: &satgs::perspective::PerspectiveView| -> Result<DepthMap, PipelineError> {
            let depth: Grid2 = v.read_depth()?;
            Ok(DepthMap::new(DepthCamera::Pinhole(v.camera), depth))
        };
        fuse(views.map(map), &options, &NoProgress).unwrap().mesh
    };
    let scores = mesh_scores(&half(0), &half(1), 0.05).unwrap();
    println!("{scores:?}");
    assert!(scores.f1 > 0.95, "{scores:?}");
}
