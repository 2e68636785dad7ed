//! Similarities, and the closed form of the one that fits pairs of points best.

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

/// A similarity `to = scale * rotation * from + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimilarityTransform {
    /// Scale.
    pub scale: f64,
    /// Rotation.
    pub rotation: DMat3,
    /// Image of the origin.
    pub translation: DVec3,
}

impl SimilarityTransform {
    /// The image of a point.
    #[must_use]
    pub fn apply(&self, p: DVec3) -> DVec3 {
        self.scale * (self.rotation * p) + self.translation
    }

    /// The least-squares similarity of pairs (from, to): Umeyama, Least-squares estimation of transformation parameters
    /// between two point patterns, 1991, equations 40 to 43. Of points on a line the turn about the line is arbitrary. None
    /// if the points are in one place in either frame.
    #[must_use]
    pub(super) fn closed_form(pairs: &[(DVec3, DVec3)]) -> Option<Self> {
        let n = pairs.len() as f64;
        let from = pairs.iter().map(|p| p.0).sum::<DVec3>() / n;
        let to = pairs.iter().map(|p| p.1).sum::<DVec3>() / n;
        let (mut covariance, mut variance) = (Matrix3::zeros(), 0.0);
        for (a, b) in pairs {
            let (a, b) = (*a - from, *b - to);
            let (va, vb) = (nalgebra::Vector3::from(a.to_array()), nalgebra::Vector3::from(b.to_array()));
            covariance += vb * va.transpose() / n;
            variance += a.length_squared() / n;
        }
        let svd = covariance.svd(true, true);
        let (u, vt) = (svd.u?, svd.v_t?);
        let mut signs = Matrix3::identity();
        if (u * vt).determinant() < 0.0 {
            signs[(2, 2)] = -1.0;
        }
        let rotation = u * signs * vt;
        let scale = (Matrix3::from_diagonal(&svd.singular_values) * signs).trace() / variance;
        let rotation = DMat3::from_cols_slice(rotation.as_slice());
        let found = Self { scale, rotation, translation: to - scale * (rotation * from) };
        (scale.is_finite() && scale > 0.0 && found.translation.is_finite()).then_some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_similarity_is_recovered_from_its_images() {
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 2.9, -0.4, 1.1);
        let truth = SimilarityTransform { scale: 3.5, rotation, translation: DVec3::new(5e5, 4e6, 120.0) };
        // All in one plane, as the centres of a drone's photographs are: a mirrored solution fits as well.
        let plane = [(0.0, 0.0), (1.0, 0.2), (0.3, 2.0), (-1.0, 0.7), (2.0, 2.0)];
        let pairs: Vec<(DVec3, DVec3)> =
            plane.iter().map(|(x, y)| DVec3::new(*x, *y, 0.5)).map(|p| (p, truth.apply(p))).collect();
        let fitted = SimilarityTransform::closed_form(&pairs).unwrap();
        assert!((fitted.scale - 3.5).abs() < 1e-6);
        assert!((fitted.rotation.determinant() - 1.0).abs() < 1e-9);
        let above = DVec3::new(0.0, 0.0, 2.0);
        assert!((fitted.apply(above) - truth.apply(above)).length() < 1e-5);
    }

    #[test]
    fn points_in_one_place_have_no_similarity() {
        assert!(SimilarityTransform::closed_form(&[(DVec3::ONE, DVec3::X); 3]).is_none());
        let one_place = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| (p, DVec3::ONE));
        assert!(SimilarityTransform::closed_form(&one_place).is_none());
    }
}
