//! The similarity that fits pairs of points best.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

/// Smallest extent of the points across their longest axis, as a share of the extent along it.
const LEAST_WIDTH: f64 = 1e-3;

/// A similarity `to = scale * rotation * from + translation` and how well it fits.
#[derive(Clone, Copy, Debug)]
pub struct SimilarityTransform {
    /// Scale.
    pub scale: f64,
    /// Rotation.
    pub rotation: DMat3,
    /// Image of the origin.
    pub translation: DVec3,
    /// Root mean square distance of the images from their targets.
    pub rms: f64,
}

impl SimilarityTransform {
    /// The image of a point.
    #[must_use]
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.scale * (self.rotation * p) + self.translation
    }

    /// The least-squares similarity of pairs (from, to): Umeyama, Least-squares estimation of transformation parameters
    /// between two point patterns, 1991, equations 40 to 43.
    ///
    /// # Errors
    /// What is missing, as text.
    pub fn to(pairs: &[(DVec3, DVec3)]) -> Result<Self, String> {
        if pairs.len() < 3 {
            return Err(format!("{} of its images have positions, 3 are needed", pairs.len()));
        }
        let n = pairs.len() as f64;
        let from = pairs.iter().map(|p| p.0).sum::<DVec3>() / n;
        let to = pairs.iter().map(|p| p.1).sum::<DVec3>() / n;
        let (mut covariance, mut spread, mut variance) = (Matrix3::zeros(), Matrix3::zeros(), 0.0);
        for (a, b) in pairs {
            let (a, b) = (*a - from, *b - to);
            let (va, vb) = (nalgebra::Vector3::from(a.to_array()), nalgebra::Vector3::from(b.to_array()));
            covariance += vb * va.transpose() / n;
            spread += va * va.transpose() / n;
            variance += a.length_squared() / n;
        }
        let mut axes: Vec<f64> = spread.symmetric_eigenvalues().iter().copied().collect();
        axes.sort_by(f64::total_cmp);
        if !(variance > 0.0 && axes[1].max(0.0).sqrt() > LEAST_WIDTH * axes[2].sqrt()) {
            return Err("the camera centres lie on a line".into());
        }
        let svd = covariance.svd(true, true);
        let (Some(u), Some(vt)) = (svd.u, svd.v_t) else {
            return Err("the positions cannot be fitted".into());
        };
        let mut signs = Matrix3::identity();
        if (u * vt).determinant() < 0.0 {
            signs[(2, 2)] = -1.0;
        }
        let rotation = u * signs * vt;
        let scale = (Matrix3::from_diagonal(&svd.singular_values) * signs).trace() / variance;
        if !(scale.is_finite() && scale > 0.0) {
            return Err("the positions are all in one place".into());
        }
        let rotation = DMat3::from_cols_slice(rotation.as_slice());
        let mut fitted = Self { scale, rotation, translation: to - scale * (rotation * from), rms: 0.0 };
        let squares = pairs.iter().map(|(a, b)| (fitted.apply(*a) - *b).length_squared()).sum::<f64>();
        fitted.rms = (squares / n).sqrt();
        Ok(fitted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similarity_is_recovered_from_its_images() {
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 2.9, -0.4, 1.1);
        let truth =
            SimilarityTransform { scale: 3.5, rotation, translation: DVec3::new(5e5, 4e6, 120.0), rms: 0.0 };
        // All in one plane, as the centres of a drone's photographs are: a mirrored solution fits as well.
        let plane = [(0.0, 0.0), (1.0, 0.2), (0.3, 2.0), (-1.0, 0.7), (2.0, 2.0)];
        let pairs: Vec<(DVec3, DVec3)> =
            plane.iter().map(|(x, y)| DVec3::new(*x, *y, 0.5)).map(|p| (p, truth.apply(p))).collect();
        let fitted = SimilarityTransform::to(&pairs).unwrap();
        assert!((fitted.scale - 3.5).abs() < 1e-6 && fitted.rms < 1e-6);
        assert!((fitted.rotation.determinant() - 1.0).abs() < 1e-9);
        let above = DVec3::new(0.0, 0.0, 2.0);
        assert!((fitted.apply(above) - truth.apply(above)).length() < 1e-5);
    }

    #[test]
    fn points_on_a_line_or_in_one_place_are_refused() {
        let pairs = |at: fn(f64) -> DVec3| [0.0, 1.0, 2.0, 3.0].map(|t| (at(t), at(t))).to_vec();
        assert!(
            SimilarityTransform::to(&pairs(|t| DVec3::new(t, 2.0 * t, 1.0))).unwrap_err().contains("line")
        );
        assert!(SimilarityTransform::to(&pairs(|_| DVec3::ONE)).is_err());
        assert!(SimilarityTransform::to(&pairs(|t| DVec3::new(t, t * t, 1.0))[..2]).is_err());
        let one_place = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| (p, DVec3::ONE));
        assert!(SimilarityTransform::to(&one_place).is_err());
    }
}
