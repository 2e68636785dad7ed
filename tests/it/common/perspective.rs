//! Small perspective scenes with known answers.

use glam::{DMat3, DQuat, DVec3};
use satgs::io::write_png_rgb;
use satgs::perspective::LensModel;
use satgs::perspective::colmap::{
    ColmapCamera, ColmapImage, ColmapModel, ColmapObservation, ColmapPoint, Format, write,
};
use std::path::Path;

/// Columns and rows of the images.
pub const SIZE: (usize, usize) = (32, 24);

/// Camera centres, not on a line; all cameras look roughly along +z at points around (0, 0, 4).
pub const CENTERS: [[f64; 3]; 4] = [[-0.6, 0.1, 0.0], [0.7, 0.0, -0.1], [0.1, -0.5, 0.2], [0.0, 0.4, 0.3]];

/// Rotation from world to camera axes of a view.
pub fn rotation(view: usize) -> DQuat {
    let t = view as f64;
    DQuat::from_euler(glam::EulerRot::XYZ, 0.02 * t - 0.03, 0.15 - 0.1 * t, 0.05 * t)
}

/// A model of four images of a camera and nine points, whose observations are the exact projections.
pub fn model(lens: LensModel, parameters: &[f64]) -> ColmapModel {
    let camera = ColmapCamera {
        id: 7,
        model: lens,
        width: SIZE.0 as u64,
        height: SIZE.1 as u64,
        parameters: parameters.to_vec(),
    };
    let shape = camera.lens().unwrap();
    let positions: Vec<[f64; 3]> = (0..9)
        .map(|i| [0.4 * f64::from(i % 3) - 0.4, 0.3 * f64::from(i / 3) - 0.3, 4.0 + 0.1 * f64::from(i)])
        .collect();
    let images = (0..CENTERS.len()).map(|view| {
        let (rotation, center) = (rotation(view), DVec3::from_array(CENTERS[view]));
        let observation = |(i, p): (usize, &[f64; 3])| {
            let px = shape.project(DMat3::from_quat(rotation) * (DVec3::from_array(*p) - center)).unwrap();
            ColmapObservation { x: px.col + 0.5, y: px.row + 0.5, point: Some(100 + i as u64) }
        };
        let unmatched = ColmapObservation { x: 1.25, y: 2.5, point: None };
        let [x, y, z, w] = rotation.to_array();
        ColmapImage {
            id: 10 + view as u32,
            rotation: [w, x, y, z],
            translation: (-(DMat3::from_quat(rotation) * center)).to_array(),
            camera: 7,
            name: format!("view {view}.png"),
            observations: positions.iter().enumerate().map(observation).chain([unmatched]).collect(),
        }
    });
    let point = |(i, p): (usize, &[f64; 3])| ColmapPoint {
        id: 100 + i as u64,
        position: *p,
        rgb: [10, 20 * i as u8, 200],
        error: 0.0,
        track: (0..CENTERS.len()).map(|view| (10 + view as u32, i as u32)).collect(),
    };
    let points = positions.iter().enumerate().map(point).collect();
    ColmapModel { cameras: vec![camera], images: images.collect(), points }
}

/// A model with a phone's lens.
pub fn phone() -> ColmapModel {
    model(LensModel::OpenCv, &[30.0, 31.0, 16.25, 11.75, 0.05, -0.02, 0.001, -0.0005])
}

/// An image in which red grows with the column and green with the row.
pub fn image(path: &Path, (width, height): (usize, usize)) {
    let pixel = |i: usize| [(4 * (i % width)) as u8, (8 * (i / width)) as u8, 50];
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_png_rgb(path, width, height, &(0..width * height).flat_map(pixel).collect::<Vec<u8>>()).unwrap();
}

/// A COLMAP project with its images.
pub fn project(folder: &Path, model: &ColmapModel, format: Format) {
    write(&folder.join("sparse/0"), model, format).unwrap();
    for view in &model.images {
        image(&folder.join("images").join(&view.name), SIZE);
    }
}

/// A 16-bit depth map as PNG, with one value per pixel.
pub fn depth_png(path: &Path, (width, height): (usize, usize), value: impl Fn(u32, u32) -> u16) {
    let pixel = |x, y| image::Luma([value(x, y)]);
    image::ImageBuffer::from_fn(width as u32, height as u32, pixel).save(path).unwrap();
}

/// Two RGB-D frames that see the plane z = 2 m, the second from 0.1 m to the right; the camera has f = 30 px.
pub fn rgbd(folder: &Path) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    write("camera-intrinsics.txt", "30 0 15.5\n0 30 11.5\n0 0 1\n");
    for (frame, x) in [("frame-000000", 0.0), ("frame-000008", 0.1)] {
        image(&folder.join(format!("{frame}.color.png")), SIZE);
        depth_png(&folder.join(format!("{frame}.depth.png")), SIZE, |col, row| match (col, row) {
            (0, 0) => 0,
            (1, 0) => 65535,
            _ => 2000,
        });
        write(&format!("{frame}.pose.txt"), &format!("1 0 0 {x}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"));
    }
}
