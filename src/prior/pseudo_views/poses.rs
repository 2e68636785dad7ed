//! Cameras of pseudo-views: beside the mean of the scene's cameras and tilted, all looking at one place.
//!
//! The paper interpolates and extrapolates between the cameras, and gives no numbers. Here four cameras are displaced by the spread
//! of the scene's cameras along their two principal axes, and four see the place from directions 25 degrees off the mean one.

use crate::perspective::PinholeCamera;
use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Focal length as a share of that of the scene's cameras: other views show what lies beside those of the scene.
const WIDER: f64 = 0.8;
/// Displacement along the principal axes, in standard deviations of the cameras.
const DISPLACEMENT: f64 = 1.0;
/// Tilt of the other pseudo-views, degrees, at this number of azimuths.
const TILT_DEG: f64 = 25.0;
const AZIMUTHS: u32 = 4;

/// Cameras that look at `target`, with the image size of the first camera and a wider field of view; none without cameras.
pub(super) fn poses(cameras: &[PinholeCamera], target: DVec3) -> Vec<PinholeCamera> {
    let Some(first) = cameras.first() else { return Vec::new() };
    let count = cameras.len() as f64;
    let middle = cameras.iter().map(|c| c.center).sum::<DVec3>() / count;
    let down = cameras.iter().map(|c| c.cam_from_site.row(1)).sum::<DVec3>() / count;
    let spread: Matrix3<f64> = cameras
        .iter()
        .map(|c| {
            let d = Vector3::from((c.center - middle).to_array());
            d * d.transpose() / count
        })
        .sum();
    let eigen = SymmetricEigen::new(spread);
    let mut order = [0, 1, 2];
    order.sort_by(|a: &usize, b: &usize| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let displaced = order[..2].iter().flat_map(|k| {
        let axis = eigen.eigenvectors.column(*k);
        let by = DISPLACEMENT * eigen.eigenvalues[*k].max(0.0).sqrt() * DVec3::new(axis[0], axis[1], axis[2]);
        [middle + by, middle - by]
    });
    let sight = middle - target;
    let across = sight.cross(down).try_normalize().unwrap_or_else(|| sight.any_orthonormal_vector());
    let tilted = (0..AZIMUTHS).map(|k| {
        let azimuth = std::f64::consts::TAU * f64::from(k) / f64::from(AZIMUTHS);
        let axis = DQuat::from_axis_angle(sight.normalize_or(DVec3::Z), azimuth) * across;
        target + DQuat::from_axis_angle(axis, TILT_DEG.to_radians()) * sight
    });
    let focal = WIDER * first.focal;
    displaced
        .chain(tilted)
        .filter_map(|center| {
            Some(PinholeCamera { cam_from_site: looking(target - center, down)?, center, focal, ..*first })
        })
        .collect()
}

/// The rotation of a camera that looks along `forward`, with its lower edge towards `down`; none if both are parallel.
fn looking(forward: DVec3, down: DVec3) -> Option<DMat3> {
    let forward = forward.try_normalize()?;
    let right = down.cross(forward).try_normalize()?;
    Some(DMat3::from_cols(right, forward.cross(right), forward).transpose())
}
