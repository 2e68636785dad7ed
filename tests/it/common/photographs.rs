//! A made run of a perspective scene: three photographs of a ball of splats, without training.

use glam::{DMat3, DQuat, DVec2, DVec3};
use satgs::perspective::{PerspectiveOptions, PerspectiveScene, PinholeCamera};
use satgs::pipeline::{PerspectiveCameras, PerspectiveManifest, TrainedPhoto};
use satgs::random::CounterRng;
use satgs::splat::ply;
use satgs::splat::recipe::Recipe;
use satgs::splat::splats::Splats;
use std::fmt::Write;
use std::path::Path;

const SIZE: (usize, usize) = (64, 48);

/// A camera on a circle of 4 m that looks at the origin; what is up in its image is the y axis downwards, as in scenes of
/// COLMAP.
fn camera(k: u32) -> PinholeCamera {
    let (sin, cos) = (f64::from(k) * 0.5).sin_cos();
    let center = DVec3::new(4.0 * cos, -1.5, 4.0 * sin);
    let forward = (-center).normalize();
    let right = forward.cross(-DVec3::Y).normalize();
    let cam_from_site = DMat3::from_cols(right, forward.cross(right), forward).transpose();
    let principal = DVec2::new(31.0, 24.0);
    PinholeCamera { cam_from_site, center, focal: DVec2::splat(55.0), principal, size: SIZE }
}

/// Makes the scene and its run in a folder, as `scene` and `run`.
pub fn make_run(folder: &Path) {
    let (scene, run) = (folder.join("scene"), folder.join("run"));
    let model = scene.join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::create_dir_all(scene.join("images")).unwrap();
    std::fs::create_dir_all(&run).unwrap();
    let (mut splats, mut points, mut images) = (Splats::default(), String::new(), String::new());
    for i in 0..400 {
        let mut draw = CounterRng::new(5, 0, 0, i);
        let p = draw.direction();
        let rgb = p.map(|v| (0.5 + 0.45 * (3.0 * v).sin()) as f32);
        splats.push(p.map(|v| v as f32), 0.12, 0.95, rgb);
        splats.f_rest.push([0.01; 45]);
        let [r, g, b] = rgb.map(|v| (255.0 * v) as u8);
        writeln!(points, "{} {} {} {} {r} {g} {b} 0.5", i + 1, p[0], p[1], p[2]).unwrap();
    }
    for k in 0..3 {
        let camera = camera(k);
        let pixels =
            (0..SIZE.0 * SIZE.1).flat_map(|i| [(i % 64 * 4) as u8, (i / 64 * 5) as u8, 40 * k as u8]);
        let rgb: Vec<u8> = pixels.collect();
        satgs::io::write_png_rgb(&scene.join(format!("images/{k}.png")), SIZE.0, SIZE.1, &rgb).unwrap();
        let q = DQuat::from_mat3(&camera.cam_from_site);
        let t = -(camera.cam_from_site * camera.center);
        writeln!(images, "{} {} {} {} {} {} {} {} 1 {k}.png\n", k + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z)
            .unwrap();
    }
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 64 48 55 55 31.5 24.5\n").unwrap();
    std::fs::write(model.join("images.txt"), images).unwrap();
    std::fs::write(model.join("points3D.txt"), points).unwrap();

    let options = PerspectiveOptions::default();
    let read = PerspectiveScene::read(&scene, &options).unwrap();
    let manifest = PerspectiveManifest::new(&scene, &options, &read);
    let cameras = PerspectiveCameras {
        site: None,
        extent_m: 4.4,
        unit: 1.0,
        area: (-1.0, -1.0, 1.0, 1.0),
        altitudes: (-1.0, 1.0),
        views: read.views.iter().map(TrainedPhoto::new).collect(),
        recipe: Recipe::named("3dgs").unwrap().of_kind().unwrap(),
    };
    satgs::io::write_json(&run.join("scene.json"), &manifest).unwrap();
    satgs::io::write_json(&run.join("cameras.json"), &cameras).unwrap();
    ply::write_local(&run.join("splats.ply"), &splats).unwrap();
}
