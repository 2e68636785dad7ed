//! Scenes in any unit, turned and moved: trainings are the same, and what a run writes is in the unit of the scene.

use super::input;
use glam::{DMat3, DQuat, DVec2, DVec3};
use satgs::io::ImageFile;
use satgs::mesh::TriangleMesh;
use satgs::perspective::{PerspectiveOptions, PinholeCamera};
use satgs::pipeline::{MeshOptions, Outcome, RenderOptions, TrainOptions, Viewpoint, mesh, render};
use satgs::progress::NoProgress;
use satgs::random::CounterRng;
use satgs::run::{AnyScene, RunOptions, StageResult};
use satgs::splat::pinhole::{NEAREST, PinholePicture};
use satgs::splat::ply;
use satgs::splat::recipe::{Densification, Recipe, RecipeKind, StartPoints};
use satgs::splat::splats::Splats;
use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt::Write;
use std::path::{Path, PathBuf};

pub const FOLDERS: &[&str] = &["near-plane-small-units"];

const SIZE: (usize, usize) = (32, 24);
const VIEWS: u32 = 9;
/// The trainings of these tests, with one check.
const ITERATIONS: u32 = 40;
const CHECK: u32 = 20;
/// Below this share of the extent splats are duplicated: all are. Where a split one's parts lie is drawn along its own axes, which do
/// not turn with the scene.
const DUPLICATED_BELOW: f64 = 1e3;

/// A change of the frame of a scene: `scale * rotation * p + translation`.
#[derive(Clone, Copy)]
struct Similarity {
    scale: f64,
    rotation: DQuat,
    translation: DVec3,
}

impl Similarity {
    fn scaled(scale: f64) -> Self {
        Self { scale, rotation: DQuat::IDENTITY, translation: DVec3::ZERO }
    }

    fn apply(&self, p: DVec3) -> DVec3 {
        self.scale * (self.rotation * p) + self.translation
    }
}

/// A camera on a circle of 4 m that looks at the origin from above.
fn camera(k: u32) -> PinholeCamera {
    let (sin, cos) = (f64::from(k) * 0.35).sin_cos();
    let center = DVec3::new(4.0 * cos, 4.0 * sin, 1.5);
    let forward = (-center).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let principal = DVec2::new(15.5, 11.5);
    PinholeCamera { cam_from_site, center, focal: DVec2::splat(28.0), principal, size: SIZE }
}

/// A ball of coloured splats, photographed from all cameras, as a COLMAP project in text form.
fn make_ball(scene: &Path) {
    let model = scene.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(scene.join("images")).unwrap();
    let (mut splats, mut points, mut images) = (Splats::default(), String::new(), String::new());
    for i in 0..400 {
        let mut draw = CounterRng::new(5, 0, 0, i);
        let p = draw.direction();
        let rgb = p.map(|v| (0.5 + 0.45 * (3.0 * v).sin()) as f32);
        splats.push(p.map(|v| v as f32), 0.12, 0.95, rgb);
        let [r, g, b] = rgb.map(|v| (255.0 * v) as u8);
        let near = p.map(|v| v + 0.02 * draw.normal());
        writeln!(points, "{} {} {} {} {r} {g} {b} 0.5", i + 1, near[0], near[1], near[2]).unwrap();
    }
    for k in 0..VIEWS {
        let camera = camera(k);
        let picture = PinholePicture::render(&splats, &camera, NEAREST);
        let pixels = 0..SIZE.0 * SIZE.1;
        let rgb: Vec<u8> = pixels
            .flat_map(|i| picture.colors.each_ref().map(|c| (255.0 * c.data[i]).round() as u8))
            .collect();
        satgs::io::write_png_rgb(&scene.join(format!("images/{k}.png")), SIZE.0, SIZE.1, &rgb).unwrap();
        let q = DQuat::from_mat3(&camera.cam_from_site);
        let t = -(camera.cam_from_site * camera.center);
        writeln!(images, "{} {} {} {} {} {} {} {} 1 {k}.png\n", k + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z)
            .unwrap();
    }
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 32 24 28 28 16 12\n").unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), points).unwrap();
}

/// Copies a COLMAP project in text form into another frame.
fn moved(scene: &Path, to: &Path, by: &Similarity) {
    let (from_model, model) = (scene.join("sparse/0"), to.join("sparse/0"));
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(to.join("images")).unwrap();
    for entry in std::fs::read_dir(scene.join("images")).unwrap() {
        let entry = entry.unwrap();
        std::fs::copy(entry.path(), to.join("images").join(entry.file_name())).unwrap();
    }
    std::fs::copy(from_model.join("cameras.txt"), model.join("cameras.txt")).unwrap();
    let text = |name: &str| std::fs::read_to_string(from_model.join(name)).unwrap();
    let numbers = |fields: &[&str]| fields.iter().map(|f| f.parse().unwrap()).collect::<Vec<f64>>();
    let (mut images, mut points) = (String::new(), String::new());
    for line in text("images.txt").lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#')) {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let n = numbers(&fields[1..8]);
        let q = DQuat::from_xyzw(n[1], n[2], n[3], n[0]).normalize() * by.rotation.inverse();
        let t = by.scale * DVec3::new(n[4], n[5], n[6]) - q * by.translation;
        let (id, name) = (fields[0], fields[9]);
        writeln!(images, "{id} {} {} {} {} {} {} {} 1 {name}\n", q.w, q.x, q.y, q.z, t.x, t.y, t.z).unwrap();
    }
    for line in text("points3D.txt").lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#')) {
        let fields: Vec<&str> = line.split_whitespace().collect();
        let n = numbers(&fields[1..4]);
        let p = by.apply(DVec3::new(n[0], n[1], n[2]));
        writeln!(points, "{} {} {} {} {} 0.5", fields[0], p.x, p.y, p.z, fields[4..7].join(" ")).unwrap();
    }
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), points).unwrap();
}

fn named(recipe: &str) -> Recipe {
    Recipe::named(recipe).unwrap()
}

/// Trains a scene; returns the number of splats and the mean PSNR of the views that are held back.
fn trained(scene: &Path, run: &Path, recipe: Recipe) -> (usize, f64) {
    let file = run.with_extension("toml");
    let densification = recipe.densification.map(|growth| Densification {
        from: CHECK,
        until: CHECK,
        copy_below: DUPLICATED_BELOW,
        ..growth
    });
    let recipe = Recipe { iterations: ITERATIONS, check_every: CHECK, densification, ..recipe };
    std::fs::write(&file, recipe.to_toml()).unwrap();
    let defaults = RunOptions::of_photographs();
    let train = TrainOptions { recipe: file.display().to_string(), ..defaults.train };
    let options = RunOptions { train, ..defaults };
    let (mut splats, mut psnr_db) = (0, f64::NAN);
    let mut completed = |result: StageResult| match result {
        StageResult::Trained(Outcome::Made(trained)) => splats = trained.splats,
        StageResult::Scored(scores) => psnr_db = scores.mean.unwrap().psnr_db,
        _ => {}
    };
    let photographs = AnyScene::read_photographs(scene, &PerspectiveOptions::default()).unwrap();
    satgs::run::run(photographs, &options, run, &NoProgress, &mut completed).unwrap();
    (splats, psnr_db)
}

/// A turn about all axes.
fn oblique() -> DQuat {
    DQuat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0)
}

/// Trains the ball by a recipe in some frames, one of them with this `turn`, and compares with the training in metres.
fn is_the_same_in_any_frame(recipe: &str, turn: DQuat) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    make_ball(&path("scene"));
    let (splats, psnr_db) = trained(&path("scene"), &path("run"), named(recipe));
    assert!(splats > 100 && psnr_db > 8.0, "{recipe}: {splats} splats, {psnr_db} dB");
    let placed = |scale: f64, rotation: DQuat| Similarity {
        scale,
        rotation,
        translation: scale * DVec3::new(30.0, -20.0, 5.0),
    };
    let frames =
        [Similarity::scaled(0.01), placed(0.05, DQuat::from_rotation_z(FRAC_PI_2)), placed(20.0, turn)];
    for (k, by) in frames.iter().enumerate() {
        let (scene, run) = (path(&format!("scene{k}")), path(&format!("run{k}")));
        moved(&path("scene"), &scene, by);
        let (n, db) = trained(&scene, &run, named(recipe));
        assert!((n as f64 / splats as f64 - 1.0).abs() < 0.02, "{recipe}: {n} splats and {splats}");
        assert!((db - psnr_db).abs() < 0.1, "{recipe}: {db} and {psnr_db} dB");
    }
}

#[test]
fn trainings_of_ellipsoids_do_not_depend_on_the_frame_of_the_scene() {
    is_the_same_in_any_frame("3dgs", oblique());
}

#[test]
fn trainings_of_discs_do_not_depend_on_the_frame_of_the_scene() {
    is_the_same_in_any_frame("2dgs", oblique());
}

#[test]
fn trainings_of_rooms_do_not_depend_on_the_frame_of_the_scene() {
    is_the_same_in_any_frame("indoor", oblique());
}

#[test]
fn trainings_of_few_aerial_views_do_not_depend_on_the_frame_of_the_scene() {
    // Adam steps along the axes: what few views leave open comes out otherwise if these are turned by less than a quarter.
    is_the_same_in_any_frame("geoprop", DQuat::from_axis_angle(DVec3::ONE.normalize(), TAU / 3.0));
}

#[test]
fn a_room_in_units_of_100_m_is_trained_as_the_same_room_in_metres() {
    let Some(small) = input("near-plane-small-units") else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // A factor that numbers take without rounding.
    let larger = Similarity::scaled(128.0);
    moved(&small, &path("large"), &larger);
    let (splats, psnr_db) = trained(&small, &path("small_run"), named("3dgs"));
    let (of_large, db) = trained(&path("large"), &path("large_run"), named("3dgs"));
    // Black images have 4 dB.
    assert!(psnr_db > 7.0, "{psnr_db} dB");
    assert_eq!(splats, of_large);
    assert!((db - psnr_db).abs() < 0.01, "{db} and {psnr_db} dB");
}

#[test]
fn what_a_run_writes_is_in_the_unit_of_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    make_ball(&path("scene"));
    moved(&path("scene"), &path("scene4"), &Similarity::scaled(4.0));
    let products = |scene: &str, run: &str| -> (Splats, f32, f64, f64) {
        let run: PathBuf = path(run);
        // By rounding, matching may add one point more or less.
        let mut recipe = named("2dgs");
        if let RecipeKind::Perspective(photographs) = &mut recipe.kind {
            photographs.start_points = StartPoints::Scene;
        }
        trained(&path(scene), &run, recipe);
        let options =
            RenderOptions { viewpoint: Viewpoint::Like("3".into()), depth: true, ..RenderOptions::default() };
        render(&run, &run.join("depth.tif"), &options, &NoProgress).unwrap();
        let depth = ImageFile::open(&run.join("depth.tif")).unwrap().read(1).unwrap();
        let summary = mesh(&run, &run.join("mesh.ply"), &MeshOptions::default(), &NoProgress).unwrap();
        let vertices = TriangleMesh::read(&run.join("mesh.ply")).unwrap().vertices;
        let highest = vertices.iter().map(|v| v[2]).fold(f64::MIN, f64::max);
        (ply::read(&run.join("splats.ply")).unwrap(), depth.at(15, 11), summary.voxel_m, highest)
    };
    let (splats, depth, voxel, highest) = products("scene", "run");
    let (of_large, deeper, wider, higher) = products("scene4", "run4");
    assert!(splats.len() == of_large.len() && (2.5..4.5).contains(&depth) && highest > 0.5);
    for (a, b) in splats.position.iter().zip(&of_large.position) {
        assert!((0..3).all(|k| (4.0 * a[k] - b[k]).abs() < 1e-5), "{a:?} and {b:?}");
    }
    for (a, b) in splats.log_scale.iter().zip(&of_large.log_scale) {
        assert!((0..2).all(|k| (a[k] + 4f32.ln() - b[k]).abs() < 1e-5), "{a:?} and {b:?}");
    }
    assert!((deeper / depth - 4.0).abs() < 1e-3, "{depth} and {deeper}");
    assert!((wider / voxel - 4.0).abs() < 1e-6 && (higher / highest - 4.0).abs() < 1e-2);
}
