//! Kernels of parallel projections: the affine camera, and one with a quadratic term for areas wider than
//! about 500 m.

use super::{CameraKernel, DepthOrder, Linearized};
use crate::simd::{Real, Simd, SimdReal, SimdVec, broadcast_each};

/// An affine camera: `(col, row) = linear p + offset`, where `p` is a position in site metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AffineKernel<T> {
    /// Linear part: rows (col, row), columns (east, north, up), pixels per metre.
    pub linear: [[T; 3]; 2],
    /// Image position of the site's origin, pixels.
    pub offset: [T; 2],
}

/// [`AffineKernel`], broadcast.
#[derive(Clone, Copy)]
pub struct AffineVectors<S: Simd> {
    linear: [[SimdVec<S>; 3]; 2],
    offset: [SimdVec<S>; 2],
}

impl<T: SimdReal> CameraKernel<T> for AffineKernel<T> {
    const ORDER: DepthOrder = DepthOrder::Altitude;
    const IS_CURVED: bool = false;
    type Broadcast<S: Simd<Scalar = T>> = AffineVectors<S>;

    #[inline(always)]
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> AffineVectors<S> {
        let [col, row] = self.linear;
        let linear = [broadcast_each(simd, col), broadcast_each(simd, row)];
        AffineVectors { linear, offset: broadcast_each(simd, self.offset) }
    }

    #[inline(always)]
    fn linearize<S: Simd<Scalar = T>>(
        _: S,
        camera: &AffineVectors<S>,
        [x, y, z]: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>> {
        let mut mean = camera.offset;
        for i in 0..2 {
            let [a, b, c] = camera.linear[i];
            mean[i] = a.mul_add(x, b.mul_add(y, c.mul_add(z, camera.offset[i])));
        }
        Linearized { mean, jacobian: camera.linear }
    }

    #[inline(always)]
    fn jacobian(&self, _: [T; 3]) -> [[T; 3]; 2] {
        self.linear
    }

    #[inline(always)]
    fn add_position_gradient(&self, _: [T; 3], by_mean: [T; 2], _: [[T; 3]; 2], out: &mut [T; 3]) {
        for k in 0..3 {
            out[k] = out[k] + self.linear[0][k] * by_mean[0] + self.linear[1][k] * by_mean[1];
        }
    }

    #[inline(always)]
    fn depth_key(&self, position: [T; 3]) -> T {
        position[2]
    }
}

/// Number of the products xx, xy, xz, yy, yz, zz of a position's coordinates.
const PRODUCTS: usize = 6;

/// An affine camera with a quadratic term: `(col, row) = linear p + offset + quadratic (xx, xy, xz, yy, yz, zz)`.
///
/// Over an area of 580 m, an affine camera deviates from the RPC by up to 0.6 px, with the quadratic term by
/// less than 0.001 px. The term moves the centres of splats only: within the extent of a splat it is
/// negligible, so that the Jacobian is that of the affine part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QuadraticKernel<T> {
    /// The affine part.
    pub affine: AffineKernel<T>,
    /// Coefficients for col and row, pixels per square metre.
    pub quadratic: [[T; PRODUCTS]; 2],
}

/// [`QuadraticKernel`], broadcast.
#[derive(Clone, Copy)]
pub struct QuadraticVectors<S: Simd> {
    affine: AffineVectors<S>,
    quadratic: [[SimdVec<S>; PRODUCTS]; 2],
}

impl<T: Real> QuadraticKernel<T> {
    /// Derivative of the quadratic term by the position: rows (col, row), columns (east, north, up), pixels
    /// per metre.
    fn slope(&self, [x, y, z]: [T; 3]) -> [[T; 3]; 2] {
        self.quadratic.map(|[xx, xy, xz, yy, yz, zz]| {
            [
                (xx + xx) * x + xy * y + xz * z,
                xy * x + (yy + yy) * y + yz * z,
                xz * x + yz * y + (zz + zz) * z,
            ]
        })
    }
}

impl<T: SimdReal> CameraKernel<T> for QuadraticKernel<T> {
    const ORDER: DepthOrder = DepthOrder::Altitude;
    const IS_CURVED: bool = false;
    type Broadcast<S: Simd<Scalar = T>> = QuadraticVectors<S>;

    #[inline(always)]
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> QuadraticVectors<S> {
        let [col, row] = self.quadratic;
        let quadratic = [broadcast_each(simd, col), broadcast_each(simd, row)];
        QuadraticVectors { affine: self.affine.broadcast(simd), quadratic }
    }

    #[inline(always)]
    fn linearize<S: Simd<Scalar = T>>(
        simd: S,
        camera: &QuadraticVectors<S>,
        [x, y, z]: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>> {
        let mut out = AffineKernel::linearize(simd, &camera.affine, [x, y, z]);
        for i in 0..2 {
            let [xx, xy, xz, yy, yz, zz] = camera.quadratic[i];
            let (by_x, by_y) = (xx * x + xy * y + xz * z, yy * y + yz * z);
            out.mean[i] = out.mean[i] + by_x * x + by_y * y + zz * z * z;
        }
        out
    }

    #[inline(always)]
    fn jacobian(&self, position: [T; 3]) -> [[T; 3]; 2] {
        self.affine.jacobian(position)
    }

    #[inline(always)]
    fn add_position_gradient(
        &self,
        position: [T; 3],
        by_mean: [T; 2],
        by_jacobian: [[T; 3]; 2],
        out: &mut [T; 3],
    ) {
        self.affine.add_position_gradient(position, by_mean, by_jacobian, out);
        let slope = self.slope(position);
        for k in 0..3 {
            out[k] = out[k] + slope[0][k] * by_mean[0] + slope[1][k] * by_mean[1];
        }
    }

    #[inline(always)]
    fn depth_key(&self, position: [T; 3]) -> T {
        position[2]
    }
}
