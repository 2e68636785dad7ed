//! Lens distortion in OpenCV's model. It is removed when images are read, so that all perspective cameras are
//! pinhole cameras.

use crate::io::Grid2;
use glam::DVec2;

/// Largest number of fixed-point iterations that invert the model, and the change, in units of the focal
/// length, below which they have converged.
const MAX_STEPS: usize = 50;
const CONVERGED: f64 = 1e-12;

/// Coefficients of OpenCV's distortion model, for positions relative to the principal point in units of the
/// focal length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial coefficients of the second, fourth and sixth power of the radius.
    pub radial: [f64; 3],
    /// Tangential coefficients `p1`, `p2`.
    pub tangential: [f64; 2],
}

/// Why a lens distortion cannot be removed.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum DistortionError {
    /// The model has no inverse at a position.
    #[error("the lens distortion has no inverse at {x:.3}, {y:.3} focal lengths from the principal point")]
    #[diagnostic(help(
        "check that the coefficients are correct and belong to OpenCV's model with three radial and two tangential terms"
    ))]
    NoInverse {
        /// Position to the right of the principal point, focal lengths.
        x: f64,
        /// Position below the principal point, focal lengths.
        y: f64,
    },
}

impl Distortion {
    /// The distorted image position of a point that a pinhole camera would show at `p` (relative to the
    /// principal point, in units of the focal length).
    #[must_use]
    pub fn distorted(&self, p: DVec2) -> DVec2 {
        let r2 = p.length_squared();
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.tangential;
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let xy = p.x * p.y;
        let tangential = DVec2::new(
            2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x),
            p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * xy,
        );
        radial * p + tangential
    }

    /// The position at which a pinhole camera would show a point that the lens shows at `q`: the inverse of
    /// [`Distortion::distorted`].
    ///
    /// # Errors
    /// [`DistortionError::NoInverse`] when the iteration does not converge.
    pub fn undistorted(&self, q: DVec2) -> Result<DVec2, DistortionError> {
        let mut p = q;
        for _ in 0..MAX_STEPS {
            let step = q - self.distorted(p);
            p += step;
            if step.length() < CONVERGED {
                return Ok(p);
            }
        }
        Err(DistortionError::NoInverse { x: q.x, y: q.y })
    }

    /// The image that a pinhole camera with the same focal lengths and principal point (pixels) would have
    /// taken, sampled bilinearly; NaN outside of the distorted image.
    #[must_use]
    pub fn undistort(&self, image: &Grid2, focal: DVec2, principal: DVec2) -> Grid2 {
        Grid2::from_fn(image.width, image.height, |col, row| {
            let p = (DVec2::new(col as f64, row as f64) - principal) / focal;
            let q = self.distorted(p) * focal + principal;
            bilinear(image, q)
        })
    }
}

/// Bilinear interpolation at a position, pixels; NaN outside of the image.
fn bilinear(image: &Grid2, at: DVec2) -> f32 {
    let (first, part) = (at.floor(), at.fract_gl());
    let value = |dc: i64, dr: i64, share: f64| match share {
        0.0 => 0.0,
        _ => share * f64::from(image.get(first.x as i64 + dc, first.y as i64 + dr)),
    };
    let upper = value(0, 0, (1.0 - part.x) * (1.0 - part.y)) + value(1, 0, part.x * (1.0 - part.y));
    let lower = value(0, 1, (1.0 - part.x) * part.y) + value(1, 1, part.x * part.y);
    (upper + lower) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of a phone camera.
    const LENS: Distortion = Distortion { radial: [0.02, -0.05, 0.01], tangential: [0.0006, -0.0004] };

    #[test]
    fn distortion_is_inverted_within_the_image() {
        for x in [-0.6, -0.2, 0.0, 0.35, 0.6] {
            for y in [-0.4, 0.1, 0.4] {
                let p = DVec2::new(x, y);
                assert!((LENS.undistorted(LENS.distorted(p)).unwrap() - p).length() < 1e-10);
            }
        }
    }

    #[test]
    fn positions_without_an_inverse_are_an_error() {
        let folds = Distortion { radial: [-2.0, 0.0, 0.0], ..LENS };
        assert!(matches!(folds.undistorted(DVec2::new(0.9, 0.0)), Err(DistortionError::NoInverse { .. })));
    }

    #[test]
    fn undistortion_restores_straight_lines() {
        let (focal, principal) = (DVec2::splat(80.0), DVec2::new(49.5, 39.5));
        // The distorted image of a scene in which the pinhole camera would see its own column numbers.
        let lens = Grid2::from_fn(100, 80, |col, row| {
            let q = (DVec2::new(col as f64, row as f64) - principal) / focal;
            (LENS.undistorted(q).unwrap().x * 80.0 + 49.5) as f32
        });
        let straight = LENS.undistort(&lens, focal, principal);
        for (col, row) in [(10, 10), (50, 40), (88, 70)] {
            assert!((straight.at(col, row) - col as f32).abs() < 0.01, "{}", straight.at(col, row));
        }
    }
}
