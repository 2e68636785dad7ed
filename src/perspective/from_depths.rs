//! Points from depth maps.

use super::error::PerspectiveError;
use super::scene::PerspectiveScene;
use super::scene_parts::ScenePoint;
use super::view::PerspectiveView;
use crate::frame::{Pixel, Point};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Sums over the points of a voxel.
#[derive(Clone, Copy, Default)]
struct Sums {
    position: DVec3,
    color: DVec3,
    points: f64,
}

/// Points of a voxel grid, by the indices of their voxels.
type Voxels = BTreeMap<[i64; 3], Sums>;

/// The points that the depth maps of training views show, with the colours of the images: the mean position and colour
/// of the points in each voxel of the edge `thinning_m` (metres, or units of the scene), in the order of the voxels. Of
/// the training views with a depth map the first is used and every `every_nth_view`-th after it.
///
/// # Errors
/// [`PerspectiveError::Field`] if the edge is not above zero, [`PerspectiveError::NoViews`] without depth maps, otherwise
/// as [`PerspectiveView::read_image`].
pub fn points_from_depths(
    scene: &PerspectiveScene,
    every_nth_view: usize,
    thinning_m: f64,
) -> Result<Vec<ScenePoint>, PerspectiveError> {
    if !(thinning_m.is_finite() && thinning_m > 0.0) {
        let (found, expected) = (thinning_m.to_string(), "a length above zero");
        return Err(PerspectiveError::field("depth maps".as_ref(), "the thinning", found, expected));
    }
    let with_depth = scene.training().filter(|v| v.depth.is_some());
    let used: Vec<&PerspectiveView> = with_depth.step_by(every_nth_view.max(1)).collect();
    if used.is_empty() {
        let path = scene.views.first().map(|v| v.image.clone()).unwrap_or_default();
        let hint = "a start from depth maps needs training views with depth maps";
        return Err(PerspectiveError::NoViews { path, hint });
    }
    let of_views: Vec<Result<Voxels, PerspectiveError>> =
        used.into_par_iter().map(|view| voxels(view, thinning_m)).collect();
    let mut all = Voxels::new();
    for of_view in of_views {
        for (voxel, more) in of_view? {
            let sums = all.entry(voxel).or_default();
            sums.position += more.position;
            sums.color += more.color;
            sums.points += more.points;
        }
    }
    let point = |sums: &Sums| {
        let (p, c) = (sums.position / sums.points, 255.0 * sums.color / sums.points);
        ScenePoint {
            position: Point::new(p.x, p.y, p.z),
            rgb: c.to_array().map(|v| v.round().clamp(0.0, 255.0) as u8),
        }
    };
    Ok(all.values().map(point).collect())
}

/// The points of one view.
fn voxels(view: &PerspectiveView, edge: f64) -> Result<Voxels, PerspectiveError> {
    let (image, depth, camera) = (view.read_image()?, view.read_depth()?, &view.camera);
    let mut out = Voxels::new();
    for row in 0..depth.height {
        for col in 0..depth.width {
            let z = f64::from(depth.at(col, row));
            let color = image.planes.each_ref().map(|p| f64::from(p.at(col, row)));
            if z.is_nan() || !image.shows_surface(row * depth.width + col) {
                continue;
            }
            let p = DVec3::from_array(camera.at_depth(Pixel::new(col as f64, row as f64), z));
            let sums = out.entry((p / edge).to_array().map(|v| v.floor() as i64)).or_default();
            sums.position += p;
            sums.color += DVec3::from_array(color);
            sums.points += 1.0;
        }
    }
    Ok(out)
}
