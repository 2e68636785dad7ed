//! The kernel of the pinhole camera.

use crate::camera::{CameraKernel, DepthOrder, Linearized, damped_quotient, damped_quotient_gradient};
use crate::simd::{Real, Simd, SimdMask, SimdReal, SimdVec, broadcast_each};
use glam::{DMat3, DVec2, DVec3};

/// The Jacobian is evaluated at most this far from the centre of the image, as a multiple of half its size
/// (3DGS). Farther outside, the linearisation would stretch splats across the whole image.
const MAX_EXTENT: f64 = 1.3;

/// The parameters of a pinhole camera in the precision of the rasteriser.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PinholeKernel<T> {
    /// Rotation from site to camera axes (right, down, forward), row by row.
    pub rotation: [[T; 3]; 3],
    /// Camera coordinates of the site's origin, metres.
    pub translation: [T; 3],
    /// Focal lengths, pixels.
    pub focal: [T; 2],
    /// Principal point, pixels.
    pub principal: [T; 2],
    /// Lowest and highest ratio of x to the depth, and of y to the depth, at which the Jacobian is evaluated.
    pub limits: [[T; 2]; 2],
    /// Depth up to which nothing is drawn.
    pub nearest: T,
}

/// [`PinholeKernel`], broadcast.
#[derive(Clone, Copy)]
pub struct PinholeVectors<S: Simd> {
    rotation: [[SimdVec<S>; 3]; 3],
    translation: [SimdVec<S>; 3],
    focal: [SimdVec<S>; 2],
    principal: [SimdVec<S>; 2],
    limits: [[SimdVec<S>; 2]; 2],
    nearest: SimdVec<S>,
}

impl<T: Real> PinholeKernel<T> {
    /// The kernel of a camera at `center` (site metres) with a rotation from site to camera axes, focal
    /// lengths and principal point in pixels, the columns and rows of its image, and the depth up to which nothing is drawn.
    #[must_use]
    pub fn new(
        cam_from_site: DMat3,
        center: DVec3,
        [focal, principal]: [DVec2; 2],
        (width, height): (usize, usize),
        nearest: f64,
    ) -> Self {
        let rows = cam_from_site.transpose().to_cols_array_2d();
        let translation = -(cam_from_site * center);
        let size = [width as f64, height as f64];
        let (focal, principal) = (focal.to_array(), principal.to_array());
        let limits = std::array::from_fn(|i| {
            let half = MAX_EXTENT * 0.5 * size[i];
            let middle = 0.5 * (size[i] - 1.0) - principal[i];
            [(middle - half) / focal[i], (middle + half) / focal[i]].map(T::from_f64)
        });
        Self {
            rotation: rows.map(|row| row.map(T::from_f64)),
            translation: translation.to_array().map(T::from_f64),
            focal: focal.map(T::from_f64),
            principal: principal.map(T::from_f64),
            limits,
            nearest: T::from_f64(nearest),
        }
    }

    /// The same camera, whose Jacobian is evaluated at every centre. Discs are drawn without approximation, so that they
    /// need no limit.
    #[must_use]
    pub fn without_limits(self) -> Self {
        Self { limits: [[-T::infinity(), T::infinity()]; 2], ..self }
    }

    /// Camera coordinates of a site position, metres.
    fn cam_from_site(&self, p: [T; 3]) -> [T; 3] {
        let mut out = self.translation;
        for (out, r) in out.iter_mut().zip(&self.rotation) {
            *out = *out + r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
        }
        out
    }

    /// The image of a position, pixels, and the largest number of pixels in any direction per metre there; none if it is
    /// not drawn.
    pub fn image_and_scale(&self, position: [T; 3]) -> Option<([T; 2], T)> {
        let c = self.cam_from_site(position);
        let is_in_front = c[2] > self.nearest;
        is_in_front.then(|| {
            let inverse = c[2].recip();
            let ratio = [c[0] * inverse, c[1] * inverse];
            let image = std::array::from_fn(|i| self.focal[i] * ratio[i] + self.principal[i]);
            // The norm of the Jacobian is at most the focal length divided by the depth, times this.
            let obliquity = (T::one() + ratio[0] * ratio[0] + ratio[1] * ratio[1]).sqrt();
            (image, self.focal[0].max(self.focal[1]) * inverse * obliquity)
        })
    }

    /// A ratio to the depth clamped to the limits of an axis, and the derivative of the clamped ratio by the
    /// given one.
    fn limited(&self, axis: usize, ratio: T) -> (T, T) {
        let [low, high] = self.limits[axis];
        let inside = ratio >= low && ratio <= high;
        (ratio.max(low).min(high), if inside { T::one() } else { T::zero() })
    }
}

impl<T: SimdReal> CameraKernel<T> for PinholeKernel<T> {
    const ORDER: DepthOrder = DepthOrder::Camera;
    const IS_CURVED: bool = true;
    type Broadcast<S: Simd<Scalar = T>> = PinholeVectors<S>;

    #[inline(always)]
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> PinholeVectors<S> {
        let [right, down, forward] = self.rotation;
        let [horizontal, vertical] = self.limits;
        PinholeVectors {
            rotation: [
                broadcast_each(simd, right),
                broadcast_each(simd, down),
                broadcast_each(simd, forward),
            ],
            translation: broadcast_each(simd, self.translation),
            focal: broadcast_each(simd, self.focal),
            principal: broadcast_each(simd, self.principal),
            limits: [broadcast_each(simd, horizontal), broadcast_each(simd, vertical)],
            nearest: SimdVec::broadcast(simd, self.nearest),
        }
    }

    #[inline(always)]
    fn linearize<S: Simd<Scalar = T>>(
        _: S,
        camera: &PinholeVectors<S>,
        p: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>> {
        let mut c = camera.translation;
        for i in 0..3 {
            let r = &camera.rotation[i];
            c[i] = c[i] + r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
        }
        // Points behind the camera are not drawn: their projection only has to be finite.
        let inverse = c[2].max(camera.nearest).reciprocal();
        let (mut mean, mut jacobian) = (camera.principal, [camera.rotation[0], camera.rotation[1]]);
        for i in 0..2 {
            let [low, high] = camera.limits[i];
            let ratio = c[i] * inverse;
            mean[i] = camera.focal[i].mul_add(ratio, camera.principal[i]);
            let (scale, limited) = (camera.focal[i] * inverse, ratio.max(low).min(high));
            for k in 0..3 {
                jacobian[i][k] = scale * (camera.rotation[i][k] - limited * camera.rotation[2][k]);
            }
        }
        Linearized { mean, jacobian }
    }

    #[inline(always)]
    fn in_front<S: Simd<Scalar = T>>(
        _: S,
        camera: &PinholeVectors<S>,
        p: [SimdVec<S>; 3],
    ) -> Option<SimdMask<S>> {
        let r = &camera.rotation[2];
        let depth = camera.translation[2] + r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
        Some(depth.greater_than(camera.nearest))
    }

    #[inline(always)]
    fn jacobian(&self, position: [T; 3]) -> [[T; 3]; 2] {
        let c = self.cam_from_site(position);
        let inverse = c[2].max(self.nearest).recip();
        std::array::from_fn(|i| {
            let (limited, _) = self.limited(i, c[i] * inverse);
            let scale = self.focal[i] * inverse;
            std::array::from_fn(|k| scale * (self.rotation[i][k] - limited * self.rotation[2][k]))
        })
    }

    #[inline(always)]
    fn add_position_gradient(
        &self,
        position: [T; 3],
        by_mean: [T; 2],
        by_jacobian: [[T; 3]; 2],
        out: &mut [T; 3],
    ) {
        let c = self.cam_from_site(position);
        let inverse = c[2].max(self.nearest).recip();
        let mut by_camera = [T::zero(); 3];
        for i in 0..2 {
            let (scale, ratio) = (self.focal[i] * inverse, c[i] * inverse);
            let (limited, slope) = self.limited(i, ratio);
            // By way of the projection.
            by_camera[i] = by_camera[i] + scale * by_mean[i];
            by_camera[2] = by_camera[2] - scale * ratio * by_mean[i];
            // By way of the Jacobian, whose row is scale (r_i - limited r_z): the scale depends on the depth,
            // the ratio on both coordinates.
            let along = |row: &[T; 3]| {
                row[0] * by_jacobian[i][0] + row[1] * by_jacobian[i][1] + row[2] * by_jacobian[i][2]
            };
            let (by_own, by_forward) = (along(&self.rotation[i]), along(&self.rotation[2]));
            let by_limited = T::zero() - scale * by_forward * slope;
            let by_scale = by_own - limited * by_forward;
            by_camera[i] = by_camera[i] + by_limited * inverse;
            by_camera[2] = by_camera[2] - (by_limited * ratio + by_scale * scale) * inverse;
        }
        for k in 0..3 {
            out[k] = out[k]
                + self.rotation[0][k] * by_camera[0]
                + self.rotation[1][k] * by_camera[1]
                + self.rotation[2][k] * by_camera[2];
        }
    }

    #[inline(always)]
    fn plane_slope<S: Simd<Scalar = T>>(
        simd: S,
        camera: &PinholeVectors<S>,
        p: [SimdVec<S>; 3],
        normal: [SimdVec<S>; 3],
    ) -> [SimdVec<S>; 2] {
        let (mut c, mut n) = (camera.translation, normal);
        for i in 0..3 {
            let r = &camera.rotation[i];
            c[i] = c[i] + r[0] * p[0] + r[1] * p[1] + r[2] * p[2];
            n[i] = r[0] * normal[0] + r[1] * normal[1] + r[2] * normal[2];
        }
        let inverse = c[2].max(camera.nearest).reciprocal();
        let along = n[0].mul_add(c[0] * inverse, n[1].mul_add(c[1] * inverse, n[2]));
        let mut slope = camera.focal;
        for i in 0..2 {
            slope[i] = damped_quotient(simd, n[i] * camera.focal[i].reciprocal(), along);
        }
        slope
    }

    #[inline(always)]
    fn add_slope_gradient(
        &self,
        position: [T; 3],
        normal: [T; 3],
        by_slope: [T; 2],
        by_position: &mut [T; 3],
        by_normal: &mut [T; 3],
    ) -> [T; 2] {
        let c = self.cam_from_site(position);
        let n: [T; 3] = self.rotation.map(|r| r[0] * normal[0] + r[1] * normal[1] + r[2] * normal[2]);
        let inverse = c[2].max(self.nearest).recip();
        let ray = [c[0] * inverse, c[1] * inverse];
        let along = n[0] * ray[0] + n[1] * ray[1] + n[2];
        let (factor, change) = damped_quotient_gradient(along);
        let scaled = [n[0] / self.focal[0], n[1] / self.focal[1]];
        let by_along = (scaled[0] * by_slope[0] + scaled[1] * by_slope[1]) * change;
        let mut by_camera = [T::zero(); 3];
        let mut by_n = [T::zero(), T::zero(), by_along];
        for i in 0..2 {
            by_n[i] = by_slope[i] * factor / self.focal[i] + ray[i] * by_along;
            by_camera[i] = n[i] * inverse * by_along;
            by_camera[2] = by_camera[2] - n[i] * ray[i] * inverse * by_along;
        }
        for k in 0..3 {
            for i in 0..3 {
                by_position[k] = by_position[k] + self.rotation[i][k] * by_camera[i];
                by_normal[k] = by_normal[k] + self.rotation[i][k] * by_n[i];
            }
        }
        scaled.map(|s| s * factor)
    }

    #[inline(always)]
    fn depth_key(&self, position: [T; 3]) -> T {
        T::zero() - self.cam_from_site(position)[2]
    }
}
