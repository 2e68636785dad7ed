//! Cameras with lens distortion, in COLMAP's models. The distortion is removed when images are read, so that all
//! cameras of views are pinhole cameras.
//!
//! The formulas are those of COLMAP's `sensor/models.h`; `x`, `y` are positions relative to the principal point in
//! units of the focal length, `r` their radius, `t = atan r` the angle from the optical axis.

use crate::frame::{CenterPx, Pixel};
use glam::{DMat2, DVec2};

/// Largest number of parameters of a model.
const MOST_PARAMETERS: usize = 12;
/// Largest number of Newton steps that invert a model, and the distance, in units of the focal length, below which they
/// have converged.
const MAX_STEPS: usize = 100;
const CONVERGED: f64 = 1e-12;
/// Step of the difference quotients of a Newton step, in units of the focal length.
const STEP: f64 = 1e-6;
/// Steps in which the radius up to which a distortion is monotone is searched, and the largest radius that is tried,
/// in units of the focal length: 84 degrees from the optical axis.
const RADIUS_STEPS: usize = 2000;
const LARGEST_RADIUS: f64 = 10.0;
/// Angle from the optical axis up to which the inverse of a fisheye lens is searched from the tangent of the angle.
const FISHEYE_START_RAD: f64 = 1.45;
/// Below these, COLMAP evaluates the model FOV by its series.
const FOV_SERIES: f64 = 1e-4;

/// COLMAP's camera models, with COLMAP's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum LensModel {
    SimplePinhole,
    Pinhole,
    SimpleRadial,
    Radial,
    OpenCv,
    OpenCvFisheye,
    FullOpenCv,
    Fov,
    SimpleRadialFisheye,
    RadialFisheye,
    ThinPrismFisheye,
}

/// A model: its name in COLMAP, and its parameters.
struct ModelInfo {
    model: LensModel,
    name: &'static str,
    /// One for both axes, or two.
    focal_lengths: usize,
    distortion: usize,
    /// Whether the distortion is a polynomial of the angle from the optical axis.
    is_fisheye: bool,
}

/// The models in the order of COLMAP's numbers.
const MODELS: [ModelInfo; 11] = [
    lens(LensModel::SimplePinhole, "SIMPLE_PINHOLE", 1, 0),
    lens(LensModel::Pinhole, "PINHOLE", 2, 0),
    lens(LensModel::SimpleRadial, "SIMPLE_RADIAL", 1, 1),
    lens(LensModel::Radial, "RADIAL", 1, 2),
    lens(LensModel::OpenCv, "OPENCV", 2, 4),
    fisheye(LensModel::OpenCvFisheye, "OPENCV_FISHEYE", 2, 4),
    lens(LensModel::FullOpenCv, "FULL_OPENCV", 2, 8),
    lens(LensModel::Fov, "FOV", 2, 1),
    fisheye(LensModel::SimpleRadialFisheye, "SIMPLE_RADIAL_FISHEYE", 1, 1),
    fisheye(LensModel::RadialFisheye, "RADIAL_FISHEYE", 1, 2),
    fisheye(LensModel::ThinPrismFisheye, "THIN_PRISM_FISHEYE", 2, 8),
];

const fn lens(model: LensModel, name: &'static str, focal_lengths: usize, distortion: usize) -> ModelInfo {
    ModelInfo { model, name, focal_lengths, distortion, is_fisheye: false }
}

const fn fisheye(model: LensModel, name: &'static str, focal_lengths: usize, distortion: usize) -> ModelInfo {
    ModelInfo { is_fisheye: true, ..lens(model, name, focal_lengths, distortion) }
}

impl LensModel {
    /// The model with a number of COLMAP.
    #[must_use]
    pub fn from_id(id: i32) -> Option<Self> {
        Some(MODELS.get(usize::try_from(id).ok()?)?.model)
    }

    /// The model with a name of COLMAP.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        MODELS.iter().find(|m| m.name == name).map(|m| m.model)
    }

    /// COLMAP's number of the model.
    #[must_use]
    pub fn id(self) -> i32 {
        self as i32
    }

    /// COLMAP's name of the model.
    #[must_use]
    pub fn name(self) -> &'static str {
        self.info().name
    }

    fn info(self) -> &'static ModelInfo {
        &MODELS[self as usize]
    }

    /// Number of parameters of the model.
    #[must_use]
    pub fn parameters(self) -> usize {
        let ModelInfo { focal_lengths, distortion, .. } = self.info();
        focal_lengths + 2 + distortion
    }

    /// Whether the first parameter is the focal length of both axes.
    fn has_one_focal(self) -> bool {
        self.info().focal_lengths == 1
    }

    /// Whether the model is a polynomial of the angle from the optical axis.
    fn is_fisheye(self) -> bool {
        self.info().is_fisheye
    }

    /// Whether the lens shows a point where a pinhole camera would.
    #[must_use]
    pub fn is_pinhole(self) -> bool {
        self.info().distortion == 0
    }
}

/// The intrinsic parameters of a camera with its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensCamera {
    /// The model of the lens.
    pub model: LensModel,
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// The principal point in centre-of-pixel coordinates (COLMAP's less half a pixel).
    pub principal: DVec2,
    /// The distortion parameters of the model in COLMAP's order, after the focal lengths and the principal point;
    /// the rest is 0.
    pub distortion: [f64; 8],
    /// Columns and rows of the image.
    pub size: (usize, usize),
}

impl LensCamera {
    /// A pinhole camera; focal lengths and principal point (centre-of-pixel coordinates) in pixels.
    #[must_use]
    pub fn pinhole(focal: DVec2, principal: DVec2, size: (usize, usize)) -> Self {
        Self { model: LensModel::Pinhole, focal, principal, distortion: [0.0; 8], size }
    }

    /// The camera with COLMAP's parameters of a model, whose principal point is (0.5, 0.5) at the centre of the first
    /// pixel. None if their number is wrong, one is not finite or a focal length is not above zero.
    #[must_use]
    pub fn from_colmap(model: LensModel, parameters: &[f64], size: (usize, usize)) -> Option<Self> {
        if parameters.len() != model.parameters() || parameters.iter().any(|p| !p.is_finite()) {
            return None;
        }
        let (focal, rest) = match parameters {
            [f, rest @ ..] if model.has_one_focal() => (DVec2::splat(*f), rest),
            [fx, fy, rest @ ..] => (DVec2::new(*fx, *fy), rest),
            _ => return None,
        };
        let [cx, cy, coefficients @ ..] = rest else { return None };
        let mut distortion = [0.0; 8];
        for (to, from) in distortion.iter_mut().zip(coefficients) {
            *to = *from;
        }
        let principal = DVec2::new(cx - 0.5, cy - 0.5);
        (focal.min_element() > 0.0).then_some(Self { model, focal, principal, distortion, size })
    }

    /// COLMAP's parameters of the camera. A model with one focal length gets that of the columns.
    #[must_use]
    pub fn to_colmap(&self) -> Vec<f64> {
        let mut out = Vec::with_capacity(MOST_PARAMETERS);
        out.push(self.focal.x);
        if !self.model.has_one_focal() {
            out.push(self.focal.y);
        }
        out.extend([self.principal.x + 0.5, self.principal.y + 0.5]);
        out.extend(self.distortion);
        out.truncate(self.model.parameters());
        out
    }

    /// The camera of the image resampled to another size.
    #[must_use]
    pub fn resized(&self, size: (usize, usize)) -> Self {
        let factor =
            DVec2::new(size.0 as f64, size.1 as f64) / DVec2::new(self.size.0 as f64, self.size.1 as f64);
        if size == self.size {
            return *self;
        }
        // A model with one focal length has two of them if the axes are resampled differently.
        Self { focal: self.focal * factor, principal: (self.principal + 0.5) * factor - 0.5, size, ..*self }
    }

    /// The position at which the lens shows a point that a pinhole camera would show at `p`, both relative to the
    /// principal point in units of the focal length.
    #[must_use]
    pub fn distorted(&self, p: DVec2) -> DVec2 {
        let d = &self.distortion;
        match self.model {
            LensModel::SimplePinhole | LensModel::Pinhole => p,
            LensModel::SimpleRadial => p * polynomial(p.length_squared(), &d[..1]),
            LensModel::Radial => p * polynomial(p.length_squared(), &d[..2]),
            LensModel::OpenCv => p * polynomial(p.length_squared(), &d[..2]) + tangential(p, d[2], d[3]),
            LensModel::FullOpenCv => {
                let [k1, k2, p1, p2, k3, k4, k5, k6] = *d;
                let r2 = p.length_squared();
                p * (polynomial(r2, &[k1, k2, k3]) / polynomial(r2, &[k4, k5, k6])) + tangential(p, p1, p2)
            }
            LensModel::Fov => p * fov_factor(p.length_squared(), d[0]),
            LensModel::OpenCvFisheye => radial_of_angle(p, &d[..4]),
            LensModel::SimpleRadialFisheye => radial_of_angle(p, &d[..1]),
            LensModel::RadialFisheye => radial_of_angle(p, &d[..2]),
            LensModel::ThinPrismFisheye => {
                let [k1, k2, p1, p2, k3, k4, sx1, sy1] = *d;
                let q = radial_of_angle(p, &[]);
                let r2 = q.length_squared();
                q * polynomial(r2, &[k1, k2, k3, k4]) + tangential(q, p1, p2) + r2 * DVec2::new(sx1, sy1)
            }
        }
    }

    /// The position at which a pinhole camera would show a point that the lens shows at `q`: the inverse of
    /// [`LensCamera::distorted`]. None where the model has no inverse.
    #[must_use]
    pub fn undistorted(&self, q: DVec2) -> Option<DVec2> {
        if self.model.is_pinhole() {
            return Some(q);
        }
        let angle = q.length();
        let mut p = q;
        if self.model.is_fisheye() && angle > f64::EPSILON && angle < FISHEYE_START_RAD {
            p *= angle.tan() / angle;
        }
        for _ in 0..MAX_STEPS {
            let residual = q - self.distorted(p);
            if residual.length() < CONVERGED {
                let inside = p.length() <= self.monotone_radius();
                return inside.then_some(p);
            }
            let slope = |step: DVec2| (self.distorted(p + step) - self.distorted(p - step)) / (2.0 * STEP);
            let jacobian = DMat2::from_cols(slope(DVec2::new(STEP, 0.0)), slope(DVec2::new(0.0, STEP)));
            let step = jacobian.inverse() * residual;
            if !step.is_finite() {
                return None;
            }
            p += step;
        }
        None
    }

    /// The largest radius up to which points farther from the optical axis are shown farther from the principal point,
    /// in units of the focal length. Beyond, a polynomial may fold the image back: nothing there is a picture of
    /// anything.
    #[must_use]
    pub fn monotone_radius(&self) -> f64 {
        let mut last = 0.0;
        for i in 1..=RADIUS_STEPS {
            let radius = LARGEST_RADIUS * i as f64 / RADIUS_STEPS as f64;
            // The tangential terms are left out by taking the mean of opposite directions.
            let there =
                self.distorted(DVec2::new(radius, 0.0)).x - self.distorted(DVec2::new(-radius, 0.0)).x;
            if there.is_nan() || there <= last {
                return LARGEST_RADIUS * (i - 1) as f64 / RADIUS_STEPS as f64;
            }
            last = there;
        }
        LARGEST_RADIUS
    }

    /// Image position of a point in camera coordinates, pixels; none if it is not in front of the camera.
    #[must_use]
    pub fn project(&self, camera: glam::DVec3) -> Option<Pixel<CenterPx>> {
        let px = self.focal * self.distorted(camera.truncate() / camera.z) + self.principal;
        (camera.z > 0.0).then(|| Pixel::new(px.x, px.y))
    }

    /// The largest distance in pixels between a pixel of the image and the place where the pinhole camera of the same
    /// focal lengths shows the same point, at the border and the centre of the image; infinite where the model has no
    /// inverse.
    #[must_use]
    pub fn largest_distortion_px(&self) -> f64 {
        /// Places along each side.
        const PLACES: usize = 16;
        let (width, height) = (self.size.0 as f64 - 1.0, self.size.1 as f64 - 1.0);
        let along = (0..=PLACES).map(|i| i as f64 / PLACES as f64);
        let border = along
            .flat_map(|t| [(t * width, 0.0), (t * width, height), (0.0, t * height), (width, t * height)]);
        let distance = |(col, row): (f64, f64)| {
            let q = (DVec2::new(col, row) - self.principal) / self.focal;
            self.undistorted(q).map_or(f64::INFINITY, |p| ((p - q) * self.focal).length())
        };
        border.map(distance).fold(0.0, f64::max)
    }
}

/// `1 + k1 s + k2 s² + …`.
fn polynomial(s: f64, coefficients: &[f64]) -> f64 {
    1.0 + s * coefficients.iter().rev().fold(0.0, |sum, k| k + s * sum)
}

/// OpenCV's tangential distortion.
fn tangential(p: DVec2, p1: f64, p2: f64) -> DVec2 {
    let (r2, xy) = (p.length_squared(), p.x * p.y);
    DVec2::new(2.0 * p1 * xy + p2 * (r2 + 2.0 * p.x * p.x), p1 * (r2 + 2.0 * p.y * p.y) + 2.0 * p2 * xy)
}

/// The position in the direction of `p` at the radius `t (1 + k1 t² + k2 t⁴ + …)`.
fn radial_of_angle(p: DVec2, coefficients: &[f64]) -> DVec2 {
    let r = p.length();
    let t = r.atan();
    if r < f64::EPSILON { p } else { p * (t * polynomial(t * t, coefficients) / r) }
}

/// Ratio of the radii in the model of Devernay and Faugeras with the field of view `omega`, radians.
fn fov_factor(r2: f64, omega: f64) -> f64 {
    let tangent = (0.5 * omega).tan();
    if omega * omega < FOV_SERIES {
        omega * omega * (r2 / 3.0 - 1.0 / 12.0) + 1.0
    } else if r2 < FOV_SERIES {
        -2.0 * tangent * (4.0 * r2 * tangent * tangent - 3.0) / (3.0 * omega)
    } else {
        (2.0 * r2.sqrt() * tangent).atan() / (r2.sqrt() * omega)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parameters of a plausible lens of every model, in COLMAP's order.
    fn lenses() -> Vec<LensCamera> {
        let distortion: [&[f64]; 11] = [
            &[],
            &[],
            &[0.03],
            &[0.02, -0.05],
            &[0.0578, -0.0805, -0.00098, 0.000156],
            &[0.01, -0.004, 0.002, -0.001],
            &[0.05, -0.08, 0.0006, -0.0004, 0.01, 0.02, -0.01, 0.003],
            &[0.9],
            &[0.02],
            &[0.02, -0.006],
            &[0.01, -0.02, 0.0005, -0.0003, 0.002, 0.0003, 0.0004, -0.0002],
        ];
        let lens = |(id, coefficients): (usize, &&[f64])| {
            let model = LensModel::from_id(id as i32).unwrap();
            let focal: &[f64] = if model.has_one_focal() { &[700.0] } else { &[700.0, 710.0] };
            let all = [focal, &[320.25, 239.75], coefficients].concat();
            LensCamera::from_colmap(model, &all, (640, 480)).unwrap()
        };
        distortion.iter().enumerate().map(lens).collect()
    }

    #[test]
    fn parameters_survive_the_way_through_colmap_and_have_its_half_pixel() {
        for lens in lenses() {
            let back = LensCamera::from_colmap(lens.model, &lens.to_colmap(), lens.size).unwrap();
            assert_eq!(back, lens);
            assert_eq!(lens.principal, DVec2::new(319.75, 239.25));
            assert_eq!(LensModel::named(lens.model.name()), LensModel::from_id(lens.model.id()));
        }
    }

    #[test]
    fn every_model_is_inverted_within_the_image() {
        for lens in lenses() {
            for (x, y) in [(-0.45, -0.34), (0.0, 0.0), (0.003, 0.002), (0.45, 0.34), (0.2, -0.3), (0.9, 0.6)]
            {
                let p = DVec2::new(x, y);
                let back = lens.undistorted(lens.distorted(p)).unwrap();
                assert!((back - p).length() < 1e-10, "{} {p} {back}", lens.model.name());
            }
        }
    }

    #[test]
    fn a_lens_that_folds_the_image_has_no_inverse_there() {
        let folds =
            LensCamera::from_colmap(LensModel::SimpleRadial, &[700.0, 320.0, 240.0, -2.0], (640, 480));
        let folds = folds.unwrap();
        // r (1 - 2 r²) grows up to r = 1 / sqrt 6 and is at most 0.272.
        assert!((folds.monotone_radius() - 6.0f64.sqrt().recip()).abs() < 0.01);
        assert_eq!(folds.undistorted(DVec2::new(0.3, 0.0)), None);
        assert!(folds.largest_distortion_px().is_infinite());
        assert!(folds.undistorted(DVec2::new(0.2, 0.0)).is_some());
    }

    #[test]
    fn the_camera_of_a_resampled_image_shows_the_same_points() {
        for lens in lenses() {
            let half = lens.resized((320, 240));
            let point = glam::DVec3::new(0.2, -0.1, 1.0);
            let (whole, small) = (lens.project(point).unwrap(), half.project(point).unwrap());
            assert!((0.5 * (whole.col + 0.5) - 0.5 - small.col).abs() < 1e-9);
            assert!((0.5 * (whole.row + 0.5) - 0.5 - small.row).abs() < 1e-9);
        }
    }

    #[test]
    fn cameras_without_a_focal_length_or_with_nan_are_refused() {
        let camera = |f: f64| LensCamera::from_colmap(LensModel::SimplePinhole, &[f, 1.0, 1.0], (2, 2));
        assert!(camera(1.0).is_some());
        for f in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(camera(f), None);
        }
    }
}
