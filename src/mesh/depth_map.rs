//! Depth maps: what is fused.

use super::{DepthCamera, MeshError};
use crate::io::Grid2;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

/// Normals that point farther down than this, or are farther from the rays, are those of depth edges.
const LOWEST_NORMAL_Z: f64 = -0.1;
const LEAST_COSINE: f64 = 0.2;

/// A depth for each pixel of a camera.
#[derive(Clone, Debug)]
pub struct DepthMap {
    /// The camera.
    pub camera: DepthCamera,
    /// Depths as the camera has them, metres; NaN where nothing is known.
    pub depth: Grid2,
    /// Red, green and blue of what is seen, encoded for display, 0 to 1; NaN where nothing is known.
    pub color: Option<[Grid2; 3]>,
    /// Unit normals of what is seen, in the axes of the site; NaN where nothing is known.
    pub normal: Option<[Grid2; 3]>,
    /// Weight of the map in means with others.
    pub weight: f32,
}

impl DepthMap {
    /// A map without colours and normals, of weight one.
    #[must_use]
    pub fn new(camera: DepthCamera, depth: Grid2) -> Self {
        Self { camera, depth, color: None, normal: None, weight: 1.0 }
    }

    /// Checks that all planes have the size of the camera's image; `index` is the number of the map.
    ///
    /// # Errors
    /// [`MeshError::DepthSize`].
    pub fn check(&self, index: usize) -> Result<(), MeshError> {
        let planes = self.color.iter().chain(&self.normal).flatten().chain([&self.depth]);
        let expected = self.camera.size();
        let wrong = planes.map(|p| (p.width, p.height)).find(|found| *found != expected);
        wrong.map_or(Ok(()), |found| Err(MeshError::DepthSize { index, found, expected }))
    }

    /// The normal in a pixel, if it is known.
    pub(super) fn normal_at(&self, pixel: usize) -> Option<Vec3> {
        let normal = Vec3::from_array(self.normal.as_ref()?.each_ref().map(|n| n.data[pixel]));
        (!normal.is_nan()).then_some(normal)
    }

    /// Sets the normals from central differences of the altitudes, if the rays are parallel. There is none at depth edges: where
    /// the surface would be seen from below, or at a grazing angle.
    pub fn estimate_normals(&mut self) {
        let DepthCamera::Parallel { camera, .. } = self.camera else { return };
        let [by_col, by_row] = camera.linear.map(DVec3::from_array);
        let towards = self.camera.step(0.0, 0.0).normalize();
        let normal = |col: i64, row: i64| {
            let slope = |dc: i64, dr: i64| {
                let [next, last] = [1, -1].map(|k| self.depth.get(col + k * dc, row + k * dr));
                0.5 * f64::from(next - last)
            };
            // The gradient of altitude less what the image says of it (its product with the direction of rays is 1).
            let n = (DVec3::Z - slope(1, 0) * by_col - slope(0, 1) * by_row).normalize();
            let is_seen = n.z >= LOWEST_NORMAL_Z && n.dot(towards) >= LEAST_COSINE;
            if is_seen { n.as_vec3().to_array() } else { [f32::NAN; 3] }
        };
        let plane = |k: usize| {
            Grid2::from_rows(self.depth.width, self.depth.height, |row, line| {
                line.iter_mut().enumerate().for_each(|(col, v)| *v = normal(col as i64, row as i64)[k]);
            })
        };
        self.normal = Some([plane(0), plane(1), plane(2)]);
    }

    /// Forgets depths that are not positive or are greater than a limit, metres, if the camera is a pinhole camera.
    pub fn forget_beyond(&mut self, depth_max_m: f64) {
        if matches!(self.camera, DepthCamera::Pinhole(_)) {
            let limit = depth_max_m as f32;
            let is_wrong = |v: &&mut f32| !(**v > 0.0 && **v <= limit);
            self.depth.data.par_iter_mut().filter(is_wrong).for_each(|v| *v = f32::NAN);
        }
    }

    /// Forgets depths of points outside of a box, metres: its lowest and highest coordinates.
    pub fn forget_outside(&mut self, [low, high]: [[f64; 3]; 2]) {
        let (low, high) = (DVec3::from_array(low), DVec3::from_array(high));
        let (camera, width) = (self.camera, self.depth.width.max(1));
        self.depth.data.par_chunks_mut(width).enumerate().for_each(|(row, line)| {
            for (col, depth) in line.iter_mut().enumerate() {
                let p = camera.point(col as f64, row as f64, f64::from(*depth));
                if !(p.cmpge(low).all() && p.cmple(high).all()) {
                    *depth = f32::NAN;
                }
            }
        });
    }
}
