//! Splats in another frame: turned, scaled, moved.

use super::harmonics_turn;
use super::primitive::PrimitiveKind;
use super::splats::Splats;
use crate::perspective::SimilarityTransform;
use glam::{DMat3, DQuat, DVec3};

impl Splats {
    /// The splats in the frame of `to = scale * rotation * from + translation`: positions, sizes, attitudes, and colours that
    /// depend on the direction of view. Rows of the rotation are the new axes. Discs stay flat.
    #[must_use]
    pub fn transformed(&self, scale: f64, rotation: [[f64; 3]; 3], translation: [f64; 3]) -> Self {
        let rotation = DMat3::from_cols_array_2d(&rotation).transpose();
        let by = SimilarityTransform { scale, rotation, translation: DVec3::from_array(translation) };
        let mut out = self.clone();
        for position in &mut out.position {
            *position = by.apply(DVec3::from_array(position.map(f64::from))).to_array().map(|v| v as f32);
        }
        let axes = if self.primitive() == PrimitiveKind::Disc { 2 } else { 3 };
        for size in out.log_scale.iter_mut().flat_map(|sizes| &mut sizes[..axes]) {
            *size = (f64::from(*size) + scale.ln()) as f32;
        }
        out.turn_shapes(rotation);
        out
    }

    /// Turns attitudes, and colours that depend on the direction; positions stay.
    pub fn turn_shapes(&mut self, rotation: DMat3) {
        let turn = DQuat::from_mat3(&rotation);
        for attitude in &mut self.rotation {
            let [w, x, y, z] = attitude.map(f64::from);
            let q = turn * DQuat::from_xyzw(x, y, z, w);
            *attitude = [q.w, q.x, q.y, q.z].map(|v| v as f32);
        }
        harmonics_turn::turn(&mut self.f_rest, rotation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::harmonics::{SeenFrom, colors};
    use crate::splat::splats::unit_quaternion;

    fn turn() -> [[f64; 3]; 3] {
        let by = DMat3::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.3);
        by.transpose().to_cols_array_2d()
    }

    fn splats() -> Splats {
        let mut splats = Splats::zeros(0);
        splats.push([1.0, -2.0, 0.5], 0.3, 0.8, [0.4, 0.5, 0.6]);
        splats.f_rest = vec![std::array::from_fn(|k| 0.02 * ((k * 37 % 11) as f32 - 5.0))];
        splats.rotation = vec![[0.9, 0.1, -0.3, 0.2]];
        splats.log_scale = vec![[-1.0, -2.0, -3.0]];
        splats
    }

    #[test]
    fn a_camera_that_moves_along_sees_the_same_colours() {
        let (splats, translation) = (splats(), [10.0, 20.0, -5.0]);
        let moved = splats.transformed(2.0, turn(), translation);
        let rotation = DMat3::from_cols_array_2d(&turn()).transpose();
        let by = SimilarityTransform { scale: 2.0, rotation, translation: DVec3::from_array(translation) };
        for center in [[4.0, 4.0, 9.0], [-3.0, 0.0, 2.0], [1.0, -8.0, 0.5]] {
            let seen = |splats: &Splats, center: [f64; 3]| {
                let mut out = Vec::new();
                let from = SeenFrom { center: center.map(|v| v as f32), degree: 3 };
                colors(splats, &from, &mut out);
                out[0]
            };
            let before = seen(&splats, center);
            let after = seen(&moved, by.apply(DVec3::from_array(center)).to_array());
            for k in 0..3 {
                assert!((before[k] - after[k]).abs() < 1e-5, "{before:?} {after:?}");
            }
        }
    }

    #[test]
    fn the_shape_turns_and_grows_with_the_frame() {
        let covariance = |s: &Splats| {
            let [w, x, y, z] = unit_quaternion(s.rotation[0].map(f64::from));
            let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
            let sizes = DVec3::from_array(s.log_scale[0].map(|l| (2.0 * f64::from(l)).exp()));
            axes * DMat3::from_diagonal(sizes) * axes.transpose()
        };
        let moved = splats().transformed(3.0, turn(), [0.0; 3]);
        let rotation = DMat3::from_cols_array_2d(&turn()).transpose();
        let expected = 9.0 * (rotation * covariance(&splats()) * rotation.transpose());
        assert!((covariance(&moved) - expected).to_cols_array().iter().all(|v| v.abs() < 1e-5));
        assert_eq!(moved.opacity_logit, splats().opacity_logit);
    }
}
