//! The camera kernel: a camera as the rasteriser sees it, linearised around each splat (EWA splatting, Zwicker et al.
//! 2001).

use crate::simd::{Real, Simd, SimdMask, SimdVec};

/// What orders splats from front to back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthOrder {
    /// Altitude, the highest first. Along any parallel ray that climbs, a higher point hides a lower one: all such cameras
    /// share one order.
    Altitude,
    /// The camera's own depth: an order for each camera.
    Camera,
}

/// A camera around the centres of splats: a scalar for each quantity, or a vector with a lane for each splat.
#[derive(Clone, Copy)]
pub struct Linearized<N> {
    /// Image of the centre, pixels (column, row).
    pub mean: [N; 2],
    /// Derivative by the position: rows (column, row), columns (east, north, up), pixels per metre.
    pub jacobian: [[N; 3]; 2],
}

/// A camera from the site frame (metres) to pixels, with centre-of-pixel coordinates.
pub trait CameraKernel<T: Real>: Copy + Default + PartialEq + Send + Sync {
    /// What orders splats for this camera.
    const ORDER: DepthOrder;
    /// Whether the Jacobian depends on the position; [`CameraKernel::add_position_gradient`] then asks for the derivatives by
    /// it.
    const IS_CURVED: bool;
    /// The camera's numbers, each in all lanes.
    type Broadcast<S: Simd<Scalar = T>>: Copy;

    /// Broadcasts the camera's numbers, once for many splats.
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> Self::Broadcast<S>;

    /// Linearises the camera around splats' centres.
    fn linearize<S: Simd<Scalar = T>>(
        simd: S,
        camera: &Self::Broadcast<S>,
        position: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>>;

    /// Which centres lie in front of the camera; none where all do.
    fn in_front<S: Simd<Scalar = T>>(
        _simd: S,
        _camera: &Self::Broadcast<S>,
        _position: [SimdVec<S>; 3],
    ) -> Option<SimdMask<S>> {
        None
    }

    /// The Jacobian around one centre, as [`CameraKernel::linearize`] gives it.
    fn jacobian(&self, position: [T; 3]) -> [[T; 3]; 2];

    /// Adds to `out` the derivatives by a centre's position, from those by its image and by the Jacobian around it.
    fn add_position_gradient(
        &self,
        position: [T; 3],
        by_mean: [T; 2],
        by_jacobian: [[T; 3]; 2],
        out: &mut [T; 3],
    );

    /// What splats are ordered by, the largest first.
    fn depth_key(&self, position: [T; 3]) -> T;
}
