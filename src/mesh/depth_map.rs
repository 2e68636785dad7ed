//! Depth maps: what is fused.

use super::{DepthCamera, MeshError};
use crate::io::Grid2;
use glam::DVec3;
use rayon::prelude::*;

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
