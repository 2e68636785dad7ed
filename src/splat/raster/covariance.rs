//! Covariances `R S² Rᵀ` of the splats (3DGS, equation 6) from scales and quaternions, opacities from logits, and their
//! gradients.

use super::splat_block::{SplatBlock, SplatGradient};
use crate::simd::Real;
use crate::simd::{Arithmetic, MAX_LANES, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::splats::Splats;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Transposes the arrays `of(0)..of(count)`, one for each splat, into vectors with one lane for each splat. Lanes
/// beyond `count` are 1.
#[inline(always)]
fn gather<S: Simd, const K: usize>(
    simd: S,
    count: usize,
    of: impl Fn(usize) -> [S::Scalar; K],
) -> [SimdVec<S>; K] {
    let mut values = [[S::Scalar::from_f64(1.0); MAX_LANES]; K];
    for i in 0..count.min(S::WIDTH) {
        let found = of(i);
        for k in 0..K {
            values[k][i] = found[k];
        }
    }
    let mut out = [SimdVec::load(simd, &values[0]); K];
    for k in 1..K {
        out[k] = SimdVec::load(simd, &values[k]);
    }
    out
}

/// Transposes vectors with one lane for each splat and passes the array of each splat to `to`; the inverse of [`gather`].
#[inline(always)]
fn scatter<S: Simd, const K: usize>(
    rows: [SimdVec<S>; K],
    count: usize,
    mut to: impl FnMut(usize, [S::Scalar; K]),
) {
    let mut values = [[S::Scalar::from_f64(0.0); MAX_LANES]; K];
    for k in 0..K {
        rows[k].store_to(&mut values[k], 0);
    }
    for i in 0..count.min(S::WIDTH) {
        let mut of = [S::Scalar::from_f64(0.0); K];
        for k in 0..K {
            of[k] = values[k][i];
        }
        to(i, of);
    }
}

/// Computes the covariances and opacities of the splats with the indices `order`, and copies their centres.
pub(super) struct CovarianceForward<'a, T> {
    pub splats: &'a Splats<T>,
    pub order: &'a [u32],
    pub blocks: &'a mut [SplatBlock<T>],
    /// Receives the sum of the opacities.
    pub opacity_sum: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for CovarianceForward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let splats = self.splats;
        let [zero, one] = broadcast_each(simd, [T::zero(), T::one()]);
        *self.opacity_sum = 0.0;
        for (block, order) in self.blocks.iter_mut().zip(self.order.chunks(MAX_LANES)) {
            for first in (0..MAX_LANES).step_by(S::WIDTH) {
                let order = order.get(first..).unwrap_or_default();
                let n = order.len();
                let position = gather(simd, n, |i| splats.position[order[i] as usize]);
                let log_scale = gather(simd, n, |i| splats.log_scale[order[i] as usize]);
                let rotation = gather(simd, n, |i| splats.rotation[order[i] as usize]);
                let [logit] = gather(simd, n, |i| splats.opacity_logit[order[i] as usize]);
                let mut variance = log_scale;
                for k in 0..3 {
                    variance[k] = (log_scale[k] + log_scale[k]).exp();
                    position[k].store_to(&mut block.position[k], first);
                }
                let covariance = Rotation::new(simd, rotation).covariance(variance);
                for k in 0..6 {
                    covariance[k].store_to(&mut block.covariance[k], first);
                }
                let opacity = (one + (zero - logit).exp()).reciprocal();
                let opacity = opacity.select_or_zero(SimdMask::first(simd, n));
                opacity.store_to(&mut block.opacity, first);
                *self.opacity_sum += opacity.sum().as_f64();
            }
        }
    }
}

/// Computes the normals of the discs with the indices `order`: unit vectors along their third axes.
pub(super) struct NormalForward<'a, T> {
    pub splats: &'a Splats<T>,
    pub order: &'a [u32],
    pub normals: &'a mut [[[T; MAX_LANES]; 3]],
}

impl<T: SimdReal> SimdKernel<T> for NormalForward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        for (normals, order) in self.normals.iter_mut().zip(self.order.chunks(MAX_LANES)) {
            for first in (0..MAX_LANES).step_by(S::WIDTH) {
                let order = order.get(first..).unwrap_or_default();
                let rotation = gather(simd, order.len(), |i| self.splats.rotation[order[i] as usize]);
                let matrix = Rotation::new(simd, rotation).matrix;
                for k in 0..3 {
                    matrix[k][2].store_to(&mut normals[k], first);
                }
            }
        }
    }
}

/// Computes the derivatives with respect to scales and quaternions from those with respect to covariances, for the splats
/// with indices from `first` on.
pub(super) struct CovarianceBackward<'a, T> {
    pub splats: &'a Splats<T>,
    /// Derivatives in the order of ranks.
    pub gradients: &'a [SplatGradient<T>],
    pub first: usize,
    /// Rank of each of the splats.
    pub rank: &'a [AtomicU32],
    /// Derivatives with respect to the normals of discs, in the order of ranks; empty for ellipsoids.
    pub by_normal: &'a [[T; 3]],
    pub log_scale: &'a mut [[T; 3]],
    pub rotation: &'a mut [[T; 4]],
}

impl<T: SimdReal> SimdKernel<T> for CovarianceBackward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { splats, gradients, by_normal, .. } = self;
        let zero = SimdVec::broadcast(simd, T::zero());
        let outputs = self.log_scale.chunks_mut(S::WIDTH).zip(self.rotation.chunks_mut(S::WIDTH));
        for (k, ((by_log_scale, by_rotation), rank)) in outputs.zip(self.rank.chunks(S::WIDTH)).enumerate() {
            let (n, first) = (rank.len(), self.first + k * S::WIDTH);
            let log_scale = gather(simd, n, |i| splats.log_scale[first + i]);
            let rotation = gather(simd, n, |i| splats.rotation[first + i]);
            let by_covariance = gather(simd, n, |i| gradients[rank[i].load(Relaxed) as usize].covariance);
            let mut scale = log_scale;
            for k in 0..3 {
                scale[k] = log_scale[k].exp();
            }
            let rotation = Rotation::new(simd, rotation);
            let (mut by_scale, mut by_matrix) = rotation.gradient(scale, by_covariance);
            if !by_normal.is_empty() {
                let by_normal = gather(simd, n, |i| by_normal[rank[i].load(Relaxed) as usize]);
                for k in 0..3 {
                    by_matrix[k][2] = by_normal[k];
                }
                by_scale[2] = zero;
            }
            let by_quaternion = rotation.quaternion_gradient(&by_matrix);
            scatter(by_scale, n, |i, v| by_log_scale[i] = v);
            scatter(by_quaternion, n, |i, v| by_rotation[i] = v);
        }
    }
}

/// The rotation of a quaternion (w, x, y, z) of any length: a scalar for each number, or a vector with a lane for each
/// splat.
struct Rotation<N> {
    quaternion: [N; 4],
    /// The reciprocal of the quaternion's squared length.
    inverse: N,
    matrix: [[N; 3]; 3],
}

impl<S: Simd> Rotation<SimdVec<S>> {
    #[inline(always)]
    fn new(simd: S, [w, x, y, z]: [SimdVec<S>; 4]) -> Self {
        let [least, one] = broadcast_each(simd, [1e-24, 1.0].map(S::Scalar::from_f64));
        Self::of([w, x, y, z], (w * w + x * x + y * y + z * z).max(least).reciprocal(), one)
    }
}

impl<N: Arithmetic> Rotation<N> {
    #[inline(always)]
    fn of(quaternion: [N; 4], inverse: N, one: N) -> Self {
        let [w, x, y, z] = quaternion;
        let two = inverse + inverse;
        let matrix = [
            [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), one - two * (x * x + y * y)],
        ];
        Self { quaternion, inverse, matrix }
    }

    /// The covariance `R S² Rᵀ` (xx, xy, xz, yy, yz, zz) for the squared scales `variance`.
    #[inline(always)]
    fn covariance(&self, variance: [N; 3]) -> [N; 6] {
        let r = &self.matrix;
        let mut out = [variance[0]; 6];
        for (e, (i, j)) in ELEMENTS.into_iter().enumerate() {
            out[e] = r[i][0] * r[j][0] * variance[0]
                + r[i][1] * r[j][1] * variance[1]
                + r[i][2] * r[j][2] * variance[2];
        }
        out
    }

    /// Derivatives with respect to the log scales and the matrix from `g`, those with respect to the covariance
    /// ([`SplatGradient::covariance`]).
    #[inline(always)]
    fn gradient(&self, scale: [N; 3], g: [N; 6]) -> ([N; 3], [[N; 3]; 3]) {
        let r = &self.matrix;
        let full = [[g[0], g[1], g[2]], [g[1], g[3], g[4]], [g[2], g[4], g[5]]];
        // With M = R S the covariance is M Mᵀ, and the derivative by M is 2 G M; here `m` is that times the scale, which is
        // the derivative by R.
        let mut m = *r;
        let mut by_log_scale = scale;
        for j in 0..3 {
            let twice = (scale[j] + scale[j]) * scale[j];
            for i in 0..3 {
                m[i][j] = twice * (full[i][0] * r[0][j] + full[i][1] * r[1][j] + full[i][2] * r[2][j]);
            }
            by_log_scale[j] = r[0][j] * m[0][j] + r[1][j] * m[1][j] + r[2][j] * m[2][j];
        }
        (by_log_scale, m)
    }

    /// Derivatives with respect to the quaternion from those with respect to the matrix.
    #[inline(always)]
    fn quaternion_gradient(&self, m: &[[N; 3]; 3]) -> [N; 4] {
        let [w, x, y, z] = self.quaternion;
        // Half the derivative by the unit quaternion, times the quaternion's length.
        let by = [
            x * (m[2][1] - m[1][2]) + y * (m[0][2] - m[2][0]) + z * (m[1][0] - m[0][1]),
            w * (m[2][1] - m[1][2]) + y * (m[0][1] + m[1][0]) + z * (m[0][2] + m[2][0])
                - (x + x) * (m[1][1] + m[2][2]),
            w * (m[0][2] - m[2][0]) + x * (m[0][1] + m[1][0]) + z * (m[1][2] + m[2][1])
                - (y + y) * (m[0][0] + m[2][2]),
            w * (m[1][0] - m[0][1]) + x * (m[0][2] + m[2][0]) + y * (m[1][2] + m[2][1])
                - (z + z) * (m[0][0] + m[1][1]),
        ];
        let along = (w * by[0] + x * by[1] + y * by[2] + z * by[3]) * self.inverse;
        let mut by_quaternion = by;
        for k in 0..4 {
            by_quaternion[k] = (self.inverse + self.inverse) * (by[k] - self.quaternion[k] * along);
        }
        by_quaternion
    }
}

/// Row and column of the elements xx, xy, xz, yy, yz, zz of a symmetric 3 x 3 matrix.
pub(super) const ELEMENTS: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariance_gradient_agrees_with_central_differences() {
        let (s, q) = ([-0.3, 0.4, 0.1], [0.8, -0.3, 0.5, 0.2]);
        let g = [0.3, -0.2, 0.5, 0.7, 0.1, -0.4];
        // Off-diagonal elements count twice, once for each of their two places in the matrix.
        let weight = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];
        let rotation = |q: [f64; 4]| Rotation::of(q, 1.0 / q.iter().map(|v| v * v).sum::<f64>(), 1.0);
        let loss = |s: [f64; 3], q| -> f64 {
            let covariance = rotation(q).covariance(s.map(|s| (2.0 * s).exp()));
            (0..6).map(|k| weight[k] * g[k] * covariance[k]).sum()
        };
        let (by_s, by_matrix) = rotation(q).gradient(s.map(f64::exp), g);
        let by_q = rotation(q).quaternion_gradient(&by_matrix);
        let e = 1e-6;
        for k in 0..3 {
            let (mut a, mut b) = (s, s);
            a[k] += e;
            b[k] -= e;
            assert!(((loss(a, q) - loss(b, q)) / (2.0 * e) - by_s[k]).abs() < 1e-8);
        }
        for k in 0..4 {
            let (mut a, mut b) = (q, q);
            a[k] += e;
            b[k] -= e;
            assert!(((loss(s, a) - loss(s, b)) / (2.0 * e) - by_q[k]).abs() < 1e-8);
        }
    }
}
