//! The camera kernel: a camera linearised around the centre of each splat, as EWA splatting needs it (Zwicker
//! et al. 2001).

use crate::simd::{Real, Simd, SimdMask, SimdVec};

/// The quantity by which splats are sorted from front to back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthOrder {
    /// Altitude, the highest first. In a parallel projection from above, a higher point occludes a lower one
    /// on the same ray, so that all such cameras share one order. The altitude of a plane is linear in the
    /// pixel.
    Altitude,
    /// Depth in the frame of the camera, the nearest first. Each camera has its own order. The reciprocal of the
    /// depth of a plane is linear in the pixel.
    Camera,
}

/// A camera linearised around the centre of a splat (`N` is a scalar), or of several splats (`N` is a vector
/// with a lane for each).
#[derive(Clone, Copy)]
pub struct Linearized<N> {
    /// Projection of the centre, pixels (column, row).
    pub mean: [N; 2],
    /// Derivative of the projection by the position: rows (column, row), columns (east, north, up), pixels per metre.
    pub jacobian: [[N; 3]; 2],
}

/// A projection from the site frame (metres east, north and up) to pixels, with (0, 0) at the centre of the
/// first pixel.
pub trait CameraKernel<T: Real>: Copy + Default + PartialEq + Send + Sync {
    /// The quantity by which splats are sorted for this camera.
    const ORDER: DepthOrder;
    /// Whether the Jacobian depends on the position. If so, [`CameraKernel::add_position_gradient`] needs the
    /// derivatives by the Jacobian.
    const IS_CURVED: bool;
    /// The parameters of the camera, each in all lanes of a vector.
    type Broadcast<S: Simd<Scalar = T>>: Copy;

    /// Broadcasts the parameters of the camera, once for many splats.
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> Self::Broadcast<S>;

    /// Linearises the camera around the centres of splats (east, north, up; site metres).
    fn linearize<S: Simd<Scalar = T>>(
        simd: S,
        camera: &Self::Broadcast<S>,
        position: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>>;

    /// Which centres lie in front of the camera. None for cameras in front of which all points lie.
    fn in_front<S: Simd<Scalar = T>>(
        _simd: S,
        _camera: &Self::Broadcast<S>,
        _position: [SimdVec<S>; 3],
    ) -> Option<SimdMask<S>> {
        None
    }

    /// The Jacobian at one centre, as [`CameraKernel::linearize`] gives it.
    fn jacobian(&self, position: [T; 3]) -> [[T; 3]; 2];

    /// Adds to `out` the derivatives of the loss by the position of a centre, from its derivatives by the
    /// projection of the centre (`by_mean`) and by the Jacobian there.
    fn add_position_gradient(
        &self,
        position: [T; 3],
        by_mean: [T; 2],
        by_jacobian: [[T; 3]; 2],
        out: &mut [T; 3],
    );

    /// The slopes of planes through the centres of splats, with unit normals in site axes.
    ///
    /// At an offset `d` of pixels from the projection of the centre, the plane has the altitude `z + slope . d`
    /// ([`DepthOrder::Altitude`]; metres per pixel) or the depth `z / (1 + slope . d)` ([`DepthOrder::Camera`];
    /// 1/pixel), where `z` is that of the centre. A plane that contains the viewing direction has slope 0.
    fn plane_slope<S: Simd<Scalar = T>>(
        simd: S,
        camera: &Self::Broadcast<S>,
        position: [SimdVec<S>; 3],
        normal: [SimdVec<S>; 3],
    ) -> [SimdVec<S>; 2];

    /// Adds the derivatives of the loss by a centre and by its normal, from those by the slope of its plane
    /// ([`CameraKernel::plane_slope`]). Returns the slope.
    fn add_slope_gradient(
        &self,
        position: [T; 3],
        normal: [T; 3],
        by_slope: [T; 2],
        by_position: &mut [T; 3],
        by_normal: &mut [T; 3],
    ) -> [T; 2];

    /// The sort key of a centre: splats are sorted from the largest key to the smallest.
    fn depth_key(&self, position: [T; 3]) -> T;
}

/// Squared denominator, of unit vectors, below which [`damped_quotient`] departs from the quotient.
const DAMPING: f64 = 1e-12;

/// `a / b` with `b / (b² + 1e-12)` in place of `1 / b`: the quotient of a number by the cosine of an angle, which is finite,
/// and smooth, when the angle passes through 90 degrees.
#[inline(always)]
pub fn damped_quotient<S: Simd>(simd: S, a: SimdVec<S>, b: SimdVec<S>) -> SimdVec<S> {
    let damping = SimdVec::broadcast(simd, S::Scalar::from_f64(DAMPING));
    a * b * b.mul_add(b, damping).reciprocal()
}

/// The factor `b / (b² + 1e-12)` of [`damped_quotient`], and its derivative by `b`.
#[inline(always)]
pub fn damped_quotient_gradient<T: Real>(b: T) -> (T, T) {
    let damping = T::from_f64(DAMPING);
    let inverse = (b * b + damping).recip();
    (b * inverse, (damping - b * b) * inverse * inverse)
}
