//! The slopes of discs (see `primitive`): their damping and their gradient.

use super::constants::LOW_PASS_PX2;
use crate::camera::{CameraKernel, DepthOrder};
use crate::simd::{Real, Simd, SimdVec, broadcast_each};

/// Largest product of the squared radius of a disc and of its squared slope, in the metric of its image: beyond it the plane
/// meets the camera's own plane close to the disc, and the disc is drawn without a slope.
pub const MAX_TILT: f64 = 0.64;
/// Smallest sum of variances that is divided by, px².
const LEAST_PX2: f64 = 1e-12;

/// The share of its slope with which a disc is drawn, from the covariance (xx, xy, yy) of its image without the low-pass
/// filter, px².
///
/// Seen edge-on, a disc has an infinite slope, while the low-pass filter widens its image. The slope is reduced where the
/// harmonic mean of the variances along the axes of the image is less than the variance of the filter.
#[inline(always)]
pub(super) fn slope_damping<S: Simd>(simd: S, [xx, xy, yy]: [SimdVec<S>; 3]) -> SimdVec<S> {
    let constants = [0.0, 1.0, 2.0 / LOW_PASS_PX2, LEAST_PX2].map(S::Scalar::from_f64);
    let [zero, one, factor, least] = broadcast_each(simd, constants);
    let determinant = xx.mul_add(yy, zero - xy * xy).max(zero);
    (factor * determinant * (xx + yy).max(least).reciprocal()).min(one)
}

/// [`slope_damping`] and its derivatives by xx, xy and yy.
fn slope_damping_gradient<T: Real>([xx, xy, yy]: [T; 3]) -> (T, [T; 3]) {
    let (factor, trace) = (T::from_f64(2.0 / LOW_PASS_PX2), (xx + yy).max(T::from_f64(LEAST_PX2)));
    let determinant = (xx * yy - xy * xy).max(T::zero());
    let damping = factor * determinant / trace;
    if damping >= T::one() {
        return (T::one(), [T::zero(); 3]);
    }
    let scale = factor / (trace * trace);
    let by = [yy * trace - determinant, -(xy + xy) * trace, xx * trace - determinant];
    (damping, by.map(|v| v * scale))
}

/// The slope of a disc in a perspective projection where its plane stays away from the camera's plane, else zero.
/// `covariance` (xx, xy, yy) is that of the image with the low-pass filter, px².
#[inline(always)]
pub(super) fn slope_in_front<S: Simd>(
    simd: S,
    [x, y]: [SimdVec<S>; 2],
    [xx, xy, yy]: [SimdVec<S>; 3],
    radius2: SimdVec<S>,
) -> [SimdVec<S>; 2] {
    let most = SimdVec::broadcast(simd, S::Scalar::from_f64(MAX_TILT));
    let tilt = radius2 * (x * (xx * x + xy * y) + y * (xy * x + yy * y));
    let is_in_front = most.greater_equal(tilt);
    [x.select_or_zero(is_in_front), y.select_or_zero(is_in_front)]
}

/// The slope with which a disc is drawn in a parallel projection, metres per pixel, from its unit normal and the covariance
/// (xx, xy, yy) of its image without the low-pass filter, px².
pub fn parallel_slope<K: CameraKernel<f64>>(camera: &K, normal: [f64; 3], covariance: [f64; 3]) -> [f64; 2] {
    let ([mut by_position, mut by_normal], zero) = ([[0.0; 3]; 2], [0.0; 3]);
    let slope = camera.add_slope_gradient(zero, normal, [0.0; 2], &mut by_position, &mut by_normal);
    let (damping, _) = slope_damping_gradient(covariance);
    slope.map(|v| v * damping)
}

/// Derivatives that follow from those by the slope of a disc as it is drawn.
pub(super) struct SlopeGradient<T> {
    /// By the covariance (xx, xy, yy) of the image; that by xy counts both places in the matrix.
    pub covariance: [T; 3],
    /// By the normal.
    pub normal: [T; 3],
}

impl<T: Real> SlopeGradient<T> {
    /// From the derivatives `by` the slope; adds those by the centre to `by_position`. `covariance` (xx, xy, yy) is that of
    /// the image without the low-pass filter, `radius2` the squared radius of the ellipse.
    #[inline(always)]
    pub fn new<K: CameraKernel<T>>(
        camera: &K,
        (position, normal): ([T; 3], [T; 3]),
        [xx, xy, yy]: [T; 3],
        radius2: T,
        by: [T; 2],
        by_position: &mut [T; 3],
    ) -> Self {
        let (damping, by_covariance) = slope_damping_gradient([xx, xy, yy]);
        let mut out = Self { covariance: [T::zero(); 3], normal: [T::zero(); 3] };
        let mut moved = *by_position;
        let by_slope = by.map(|by| by * damping);
        let [x, y] = camera.add_slope_gradient(position, normal, by_slope, &mut moved, &mut out.normal);
        if matches!(K::ORDER, DepthOrder::Camera) {
            let low_pass = T::from_f64(LOW_PASS_PX2);
            let tilt = x * ((xx + low_pass) * x + xy * y) + y * (xy * x + (yy + low_pass) * y);
            if radius2 * damping * damping * tilt > T::from_f64(MAX_TILT) {
                return Self { covariance: [T::zero(); 3], normal: [T::zero(); 3] };
            }
        }
        *by_position = moved;
        out.covariance = by_covariance.map(|v| v * (x * by[0] + y * by[1]));
        out
    }
}
