//! The COLMAP model of a test set, as text (<https://colmap.github.io/format.html>).

use super::camera::PinholeCamera;
use super::points::FoundPoint;
use crate::io::{WriteError, write_file};
use std::fmt::Write;
use std::path::Path;

/// Number of the camera of image `i` in the model.
const fn number(i: usize) -> usize {
    i + 1
}

/// Writes `cameras.txt`, `images.txt` and `points3D.txt`. Images are called as `names` say; all have the first camera's lens.
pub(super) fn write(
    folder: &Path,
    cameras: &[PinholeCamera],
    names: &[String],
    points: &[FoundPoint],
) -> Result<(), WriteError> {
    write_file(&folder.join("cameras.txt"), cameras_text(cameras))?;
    write_file(&folder.join("images.txt"), images_text(cameras, names, points))?;
    write_file(&folder.join("points3D.txt"), points_text(cameras.len(), points))
}

// Writing to a string cannot fail: results are not looked at below.

fn cameras_text(cameras: &[PinholeCamera]) -> String {
    let mut text = "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]: fx, fy, cx, cy\n".to_owned();
    if let Some(PinholeCamera { size_px, focal_px, .. }) = cameras.first() {
        let middle = 0.5 * *size_px as f64;
        let _ = writeln!(text, "1 PINHOLE {size_px} {size_px} {focal_px} {focal_px} {middle} {middle}");
    }
    text
}

fn images_text(cameras: &[PinholeCamera], names: &[String], points: &[FoundPoint]) -> String {
    let mut found = vec![String::new(); cameras.len()];
    for (k, point) in points.iter().enumerate() {
        for (i, px) in &point.seen {
            let separator = if found[*i].is_empty() { "" } else { " " };
            let _ = write!(found[*i], "{separator}{:.3} {:.3} {}", px.col, px.row, number(k));
        }
    }
    let mut text = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n\
                    # POINTS2D[] as (X, Y, POINT3D_ID)\n"
        .to_owned();
    for (i, (camera, name)) in cameras.iter().zip(names).enumerate() {
        let [w, x, y, z] = camera.quaternion();
        let t = camera.translation();
        let _ = writeln!(text, "{} {w} {x} {y} {z} {} {} {} 1 {name}", number(i), t.x, t.y, t.z);
        let _ = writeln!(text, "{}", found[i]);
    }
    text
}

fn points_text(images: usize, points: &[FoundPoint]) -> String {
    let mut text = "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n".to_owned();
    let mut next = vec![0usize; images];
    for (k, point) in points.iter().enumerate() {
        let ([x, y, z], [r, g, b]) = (point.position.to_array(), point.rgb);
        let _ = write!(text, "{} {x:.6} {y:.6} {z:.6} {r} {g} {b} {:.3}", number(k), point.error_px);
        for (i, _) in &point.seen {
            let _ = write!(text, " {} {}", number(*i), next[*i]);
            next[*i] += 1;
        }
        text.push('\n');
    }
    text
}
