//! Pinhole cameras without distortion, for square images.

use crate::frame::{CenterPx, Pixel};
use glam::{DMat3, DQuat, DVec3};

/// A pinhole camera; its principal point is the middle of the image.
#[derive(Clone, Debug)]
pub(in crate::simulate) struct PinholeCamera {
    /// Columns and rows.
    pub(in crate::simulate) size_px: usize,
    /// Focal length, pixels.
    pub(in crate::simulate) focal_px: f64,
    /// Position in the world, metres.
    pub(in crate::simulate) center: DVec3,
    /// Unit vectors to the right, downwards and forwards, in the world.
    pub(in crate::simulate) axes: [DVec3; 3],
}

impl PinholeCamera {
    /// A camera at `center` that looks at `target`; `up` points upwards in its image and must not be parallel to the view.
    pub(in crate::simulate) fn looking_at(
        center: DVec3,
        target: DVec3,
        up: DVec3,
        size_px: usize,
        focal_px: f64,
    ) -> Self {
        let forward = (target - center).normalize();
        let right = forward.cross(up).normalize();
        Self { size_px, focal_px, center, axes: [right, forward.cross(right), forward] }
    }

    /// The direction of a pixel's ray in the world, one metre long along the optical axis: distances along it are depths.
    pub(in crate::simulate) fn direction(&self, px: Pixel<CenterPx>) -> DVec3 {
        let middle = 0.5 * (self.size_px as f64 - 1.0);
        let [right, down, forward] = self.axes;
        (right * (px.col - middle) + down * (px.row - middle)) / self.focal_px + forward
    }

    /// The pixel at which a place appears, and its depth in metres; none for places behind the camera.
    pub(in crate::simulate) fn project(&self, place: DVec3) -> Option<(Pixel<CenterPx>, f64)> {
        let [x, y, depth] = self.turned(place - self.center).to_array();
        let middle = 0.5 * (self.size_px as f64 - 1.0);
        let at = |v: f64| middle + self.focal_px * v / depth;
        (depth > 0.0).then(|| (Pixel::new(at(x), at(y)), depth))
    }

    /// Whether an image position is at least `margin_px` inside of the outer corners of the image.
    pub(in crate::simulate) fn contains(&self, px: Pixel<CenterPx>, margin_px: f64) -> bool {
        let (first, last) = (margin_px - 0.5, self.size_px as f64 - 0.5 - margin_px);
        (first..=last).contains(&px.col) && (first..=last).contains(&px.row)
    }

    /// A vector of the world in the camera's axes: right, down, forward.
    pub(in crate::simulate) fn turned(&self, vector: DVec3) -> DVec3 {
        DVec3::from_array(self.axes.map(|axis| axis.dot(vector)))
    }

    /// Rotation from world to camera axes as COLMAP states it: a quaternion, its real part first.
    pub(in crate::simulate) fn quaternion(&self) -> [f64; 4] {
        let [right, down, forward] = self.axes;
        let [x, y, z, w] =
            DQuat::from_mat3(&DMat3::from_cols(right, down, forward)).normalize().conjugate().to_array();
        // Of the two quaternions of a rotation, that with a real part above zero.
        let sign = if w < 0.0 { -1.0 } else { 1.0 };
        [w, x, y, z].map(|v| v * sign)
    }

    /// Camera coordinates of the world's origin, metres.
    pub(in crate::simulate) fn translation(&self) -> DVec3 {
        -self.turned(self.center)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_looks_north_has_east_on_its_right_and_the_ground_below() {
        let (center, north) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 9.0, 3.0));
        let camera = PinholeCamera::looking_at(center, north, DVec3::Z, 101, 80.0);
        let at = |place: DVec3| camera.project(place).unwrap();
        assert_eq!(at(north), (Pixel::new(50.0, 50.0), 7.0));
        let (px, depth) = at(DVec3::new(2.0, 10.0, 2.0));
        assert!((px.col - 60.0).abs() < 1e-12 && (px.row - 60.0).abs() < 1e-12 && depth == 8.0);
        assert!(camera.project(DVec3::ZERO).is_none());
    }

    #[test]
    fn quaternion_and_translation_bring_a_place_into_camera_axes() {
        let center = DVec3::new(-1.0, 0.4, 1.6);
        let camera = PinholeCamera::looking_at(center, DVec3::new(1.3, -0.7, 0.2), DVec3::Z, 64, 50.0);
        let [w, x, y, z] = camera.quaternion();
        let place = DVec3::new(0.3, -2.0, 0.9);
        let there = DQuat::from_xyzw(x, y, z, w) * place + camera.translation();
        assert!((there - camera.turned(place - center)).length() < 1e-12 && w > 0.0);
    }
}
