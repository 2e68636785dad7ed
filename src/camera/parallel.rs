//! The kernel of parallel projections: an affine camera with a quadratic term.

use super::{CameraKernel, DepthOrder, Linearized, damped_quotient, damped_quotient_gradient};
use crate::simd::{Real, Simd, SimdReal, SimdVec, broadcast_each};

/// Number of the products xx, xy, xz, yy, yz, zz of a position's coordinates.
const PRODUCTS: usize = 6;

/// An affine camera with a quadratic term: `(col, row) = linear p + offset + quadratic (xx, xy, xz, yy, yz, zz)`.
///
/// The quadratic term moves the centres of splats only: within the extent of a splat it is negligible, so that the Jacobian
/// is that of the affine part.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct QuadraticKernel<T> {
    /// Linear part: rows (col, row), columns (east, north, up), pixels per metre.
    pub linear: [[T; 3]; 2],
    /// Image position of the site's origin, pixels.
    pub offset: [T; 2],
    /// Coefficients of the quadratic term for col and row, pixels per square metre; zero for an affine camera.
    pub quadratic: [[T; PRODUCTS]; 2],
}

/// [`QuadraticKernel`], broadcast.
#[derive(Clone, Copy)]
pub struct QuadraticVectors<S: Simd> {
    linear: [[SimdVec<S>; 3]; 2],
    offset: [SimdVec<S>; 2],
    quadratic: [[SimdVec<S>; PRODUCTS]; 2],
    /// [`QuadraticKernel::inverse`].
    ground_per_pixel: [[SimdVec<S>; 2]; 2],
    sight: [SimdVec<S>; 2],
}

impl<T: Real> QuadraticKernel<T> {
    /// Projection of a point, pixels (column, row).
    pub fn project(&self, [x, y, z]: [T; 3]) -> [T; 2] {
        std::array::from_fn(|i| {
            let [a, b, c] = self.linear[i];
            let [xx, xy, xz, yy, yz, zz] = self.quadratic[i];
            let curved = (xx * x + xy * y + xz * z) * x + (yy * y + yz * z) * y + zz * z * z;
            a * x + b * y + c * z + self.offset[i] + curved
        })
    }

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

    /// Metres east and north for a pixel to the right and for a pixel down at the same altitude: rows (east, north),
    /// columns (col, row); and metres east and north for a metre of altitude in the same pixel.
    fn inverse(&self) -> ([[T; 2]; 2], [T; 2]) {
        let [[a, b, p], [c, d, q]] = self.linear;
        let factor = (a * d - b * c).recip();
        let ground = [[d * factor, -b * factor], [-c * factor, a * factor]];
        (ground, ground.map(|[col, row]| -(col * p + row * q)))
    }
}

impl<T: SimdReal> CameraKernel<T> for QuadraticKernel<T> {
    const ORDER: DepthOrder = DepthOrder::Altitude;
    const IS_CURVED: bool = false;
    type Broadcast<S: Simd<Scalar = T>> = QuadraticVectors<S>;

    #[inline(always)]
    fn broadcast<S: Simd<Scalar = T>>(&self, simd: S) -> QuadraticVectors<S> {
        let ([a, b], [p, q]) = (self.linear, self.quadratic);
        let ([east, north], sight) = self.inverse();
        QuadraticVectors {
            ground_per_pixel: [broadcast_each(simd, east), broadcast_each(simd, north)],
            sight: broadcast_each(simd, sight),
            linear: [broadcast_each(simd, a), broadcast_each(simd, b)],
            offset: broadcast_each(simd, self.offset),
            quadratic: [broadcast_each(simd, p), broadcast_each(simd, q)],
        }
    }

    #[inline(always)]
    fn linearize<S: Simd<Scalar = T>>(
        _: S,
        camera: &QuadraticVectors<S>,
        [x, y, z]: [SimdVec<S>; 3],
    ) -> Linearized<SimdVec<S>> {
        let mut mean = camera.offset;
        for i in 0..2 {
            let [a, b, c] = camera.linear[i];
            let affine = a.mul_add(x, b.mul_add(y, c.mul_add(z, camera.offset[i])));
            let [xx, xy, xz, yy, yz, zz] = camera.quadratic[i];
            let (by_x, by_y) = (xx.mul_add(x, xy.mul_add(y, xz * z)), yy.mul_add(y, yz * z));
            mean[i] = by_x.mul_add(x, by_y.mul_add(y, (zz * z).mul_add(z, affine)));
        }
        Linearized { mean, jacobian: camera.linear }
    }

    #[inline(always)]
    fn jacobian(&self, _: [T; 3]) -> [[T; 3]; 2] {
        self.linear
    }

    #[inline(always)]
    fn add_position_gradient(&self, position: [T; 3], by_mean: [T; 2], _: [[T; 3]; 2], out: &mut [T; 3]) {
        let slope = self.slope(position);
        for k in 0..3 {
            out[k] = out[k] + self.linear[0][k] * by_mean[0] + self.linear[1][k] * by_mean[1];
            out[k] = out[k] + slope[0][k] * by_mean[0] + slope[1][k] * by_mean[1];
        }
    }

    #[inline(always)]
    fn plane_slope<S: Simd<Scalar = T>>(
        simd: S,
        camera: &QuadraticVectors<S>,
        _: [SimdVec<S>; 3],
        [x, y, z]: [SimdVec<S>; 3],
    ) -> [SimdVec<S>; 2] {
        let ([east, north], sight) = (camera.ground_per_pixel, camera.sight);
        let along = sight[0].mul_add(x, sight[1].mul_add(y, z));
        let zero = SimdVec::broadcast(simd, T::zero());
        let mut slope = east;
        for k in 0..2 {
            slope[k] = zero - damped_quotient(simd, east[k].mul_add(x, north[k] * y), along);
        }
        slope
    }

    #[inline(always)]
    fn add_slope_gradient(
        &self,
        _: [T; 3],
        [x, y, z]: [T; 3],
        by_slope: [T; 2],
        _: &mut [T; 3],
        by_normal: &mut [T; 3],
    ) -> [T; 2] {
        let ([east, north], sight) = self.inverse();
        let along = sight[0] * x + sight[1] * y + z;
        let (factor, change) = damped_quotient_gradient(along);
        let across: [T; 2] = std::array::from_fn(|k| east[k] * x + north[k] * y);
        let by_along = -(across[0] * by_slope[0] + across[1] * by_slope[1]) * change;
        let by_across = by_slope.map(|by| -by * factor);
        by_normal[0] = by_normal[0] + east[0] * by_across[0] + east[1] * by_across[1] + sight[0] * by_along;
        by_normal[1] = by_normal[1] + north[0] * by_across[0] + north[1] * by_across[1] + sight[1] * by_along;
        by_normal[2] = by_normal[2] + by_along;
        across.map(|a| -a * factor)
    }

    #[inline(always)]
    fn depth_key(&self, position: [T; 3]) -> T {
        position[2]
    }
}
