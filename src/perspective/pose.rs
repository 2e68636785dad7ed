//! Poses of cameras as files state them.

use glam::{DMat3, DQuat, DVec3};

/// Largest difference of a rotation matrix times its transpose from the identity; files round to three digits or more.
const ROTATION_TOLERANCE: f64 = 2e-2;

/// Why an image is left out whose pose is not finite.
pub(super) const LOST_POSE: &str = "its pose is lost: it is not finite";

/// Where a camera stands and looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Rotation from world axes to camera axes (right, down, forward).
    pub cam_from_world: DMat3,
    /// The projection centre in world coordinates.
    pub center: DVec3,
}

impl Pose {
    /// The pose of COLMAP: a quaternion (w first) and a translation from world to camera. An error says what was found
    /// and what is expected.
    pub(super) fn from_colmap(quaternion: [f64; 4], translation: [f64; 3]) -> Result<Self, (String, String)> {
        let [w, x, y, z] = quaternion;
        let norm = quaternion.iter().map(|q| q * q).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > f64::MIN_POSITIVE) {
            return Err((format!("{quaternion:?}"), "a quaternion that is not zero".into()));
        }
        if translation.iter().any(|t| !t.is_finite()) {
            return Err((format!("{translation:?}"), "a finite translation".into()));
        }
        let cam_from_world = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let center = -(cam_from_world.transpose() * DVec3::from_array(translation));
        Ok(Self { cam_from_world, center })
    }

    /// The pose of a matrix from camera to world coordinates, row by row, whose camera axes are right, down, forward. An
    /// error says what was found and what is expected.
    pub(super) fn from_camera_to_world(rows: &[[f64; 4]]) -> Result<Self, (String, String)> {
        let [a, b, c, ..] = rows else {
            return Err((format!("{} rows", rows.len()), "3 or 4 rows of 4 numbers".into()));
        };
        if rows.iter().flatten().any(|v| !v.is_finite()) {
            return Err(("not finite".into(), "a matrix of finite numbers".into()));
        }
        let world_from_cam = DMat3::from_cols_array(&[a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]]);
        let unit = world_from_cam.transpose() * world_from_cam - DMat3::IDENTITY;
        let off = unit.to_cols_array().iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if off > ROTATION_TOLERANCE || world_from_cam.determinant() < 0.0 {
            let found = format!("off by {off:.3}, determinant {:.3}", world_from_cam.determinant());
            return Err((found, "a rotation in the first three columns".into()));
        }
        // Rounded matrices are made rotations again.
        let rotation = DMat3::from_quat(DQuat::from_mat3(&world_from_cam).normalize());
        Ok(Self { cam_from_world: rotation.transpose(), center: DVec3::new(a[3], b[3], c[3]) })
    }

    /// Whether a matrix states that the pose is not known: no number, or one that is not finite, as programs write it of images
    /// that they cannot place.
    pub(super) fn is_lost(rows: &[[f64; 4]]) -> bool {
        rows.iter().flatten().any(|v| !v.is_finite())
    }

    /// The same as [`Pose::from_camera_to_world`] for camera axes right, up, backward, those of OpenGL and NeRF.
    pub(super) fn from_opengl_to_world(rows: &[[f64; 4]]) -> Result<Self, (String, String)> {
        let flipped: Vec<[f64; 4]> = rows.iter().map(|r| [r[0], -r[1], -r[2], r[3]]).collect();
        Self::from_camera_to_world(&flipped)
    }

    /// The same as [`Pose::from_camera_to_world`] for a matrix from world to camera coordinates.
    pub(super) fn from_world_to_camera(rows: &[[f64; 4]]) -> Result<Self, (String, String)> {
        let inverse = Self::from_camera_to_world(rows)?;
        let cam_from_world = inverse.cam_from_world.transpose();
        Ok(Self { cam_from_world, center: -(cam_from_world.transpose() * inverse.center) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_four_forms_of_a_pose_agree() {
        let quaternion = DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.8, 1.9);
        let pose = Pose { cam_from_world: DMat3::from_quat(quaternion), center: DVec3::new(1.0, -2.0, 3.0) };
        let same = |other: Pose| {
            let off = pose.cam_from_world - other.cam_from_world;
            off.to_cols_array().iter().all(|v| v.abs() < 1e-12)
                && (pose.center - other.center).length() < 1e-12
        };
        let t = -(pose.cam_from_world * pose.center);
        let [x, y, z, w] = quaternion.to_array();
        assert!(same(Pose::from_colmap([2.0 * w, 2.0 * x, 2.0 * y, 2.0 * z], t.to_array()).unwrap()));
        let matrix = |r: DMat3, t: DVec3| -> [[f64; 4]; 3] {
            std::array::from_fn(|i| [r.col(0)[i], r.col(1)[i], r.col(2)[i], t[i]])
        };
        let back = pose.cam_from_world.transpose();
        assert!(same(Pose::from_camera_to_world(&matrix(back, pose.center)).unwrap()));
        assert!(same(Pose::from_world_to_camera(&matrix(pose.cam_from_world, t)).unwrap()));
        let opengl = back * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        assert!(same(Pose::from_opengl_to_world(&matrix(opengl, pose.center)).unwrap()));
    }

    #[test]
    fn what_is_no_rotation_is_refused() {
        assert!(Pose::from_colmap([0.0; 4], [0.0; 3]).is_err());
        assert!(Pose::from_colmap([f64::NAN, 0.0, 0.0, 1.0], [0.0; 3]).is_err());
        assert!(Pose::from_colmap([1.0, 0.0, 0.0, 0.0], [f64::NAN; 3]).is_err());
        let rows = |d: f64| [[d, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
        assert!(Pose::from_camera_to_world(&rows(1.0)).is_ok());
        for d in [0.0, -1.0, 2.0, f64::NAN] {
            assert!(Pose::from_camera_to_world(&rows(d)).is_err(), "{d}");
        }
        assert!(Pose::from_camera_to_world(&rows(1.0)[..2]).is_err());
    }
}
