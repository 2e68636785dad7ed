//! What all cameras of an iteration share: the altitude order, covariances, opacities; and the way back from
//! their gradients to the parameters.

use crate::splat::gaussians::{Gaussians, rotation_matrix, sigmoid};
use crate::splat::real::Real;
use rayon::prelude::*;

/// Splats in order of altitude, highest first, ready to be projected.
#[derive(Default)]
pub struct Prepared<T> {
    /// Index of the splat at each rank.
    order: Vec<u32>,
    /// Rank of each splat.
    rank: Vec<u32>,
    keys: Vec<(u32, u32)>,
    pub(super) splats: Vec<PreparedSplat<T>>,
}

/// One splat as every camera needs it.
#[derive(Clone, Copy, Debug)]
pub(super) struct PreparedSplat<T> {
    pub position: [T; 3],
    /// xx, xy, xz, yy, yz, zz; m².
    pub covariance: [T; 6],
    pub opacity: T,
}

/// Derivatives of the loss by what [`Prepared`] holds of one splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SplatGradient<T> {
    /// By the centre.
    pub position: [T; 3],
    /// By the covariance's elements xx, xy, xz, yy, yz, zz, the matrix taken as nine independent numbers.
    pub covariance: [T; 6],
    /// By the opacity's logit.
    pub logit: T,
}

/// A whole number that grows as a float falls.
fn descending_key(altitude: f32) -> u32 {
    let bits = altitude.to_bits();
    let ascending = if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
    !ascending
}

impl<T: Real> Prepared<T> {
    /// Number of splats.
    #[must_use]
    pub fn len(&self) -> usize {
        self.splats.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.splats.is_empty()
    }

    /// Index of the splat at each rank.
    #[must_use]
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Orders the splats and computes what cameras share.
    pub fn update(&mut self, gaussians: &Gaussians<T>) {
        let n = gaussians.len();
        if self.order.len() != n {
            self.order = (0..n as u32).collect();
        }
        self.keys.clear();
        let key = |i: u32| (descending_key(gaussians.position[i as usize][2].wide() as f32), i);
        // Last iteration's order is nearly this one's: the sort finds long runs and merges them.
        self.keys.extend(self.order.iter().map(|&i| key(i)));
        self.keys.par_sort();
        self.order.clear();
        self.order.extend(self.keys.iter().map(|k| k.1));
        self.rank.resize(n, 0);
        for (rank, &i) in self.order.iter().enumerate() {
            self.rank[i as usize] = rank as u32;
        }
        let order = &self.order;
        self.splats.clear();
        self.splats.par_extend((0..n).into_par_iter().with_min_len(1024).map(|r| {
            let i = order[r] as usize;
            PreparedSplat {
                position: gaussians.position[i],
                covariance: covariance(gaussians.log_scale[i], gaussians.rotation[i]),
                opacity: sigmoid(gaussians.logit[i]),
            }
        }));
    }

    /// Writes into `out` the derivatives by the parameters (colour excepted), from those by what cameras share.
    pub fn parameter_gradients(
        &self,
        gaussians: &Gaussians<T>,
        gradients: &[SplatGradient<T>],
        out: &mut Gaussians<T>,
    ) {
        let rank = &self.rank;
        let rows =
            out.position.par_iter_mut().zip(&mut out.log_scale).zip(&mut out.rotation).zip(&mut out.logit);
        rows.with_min_len(1024).enumerate().for_each(|(i, (((position, log_scale), rotation), logit))| {
            let g = &gradients[rank[i] as usize];
            *position = g.position;
            *logit = g.logit;
            (*log_scale, *rotation) =
                covariance_gradient(gaussians.log_scale[i], gaussians.rotation[i], g.covariance);
        });
    }

    /// Rank of a splat.
    #[must_use]
    pub fn rank(&self, splat: usize) -> usize {
        self.rank[splat] as usize
    }
}

/// `R S² Rᵀ`.
fn covariance<T: Real>(log_scale: [T; 3], rotation: [T; 4]) -> [T; 6] {
    let (r, _) = rotation_matrix(rotation);
    let variance = log_scale.map(|s| (s + s).exp());
    let element = |i: usize, j: usize| (0..3).map(|k| r[i][k] * r[j][k] * variance[k]).sum();
    [element(0, 0), element(0, 1), element(0, 2), element(1, 1), element(1, 2), element(2, 2)]
}

/// Derivatives by log scale and quaternion from those by the covariance (`g`).
fn covariance_gradient<T: Real>(log_scale: [T; 3], rotation: [T; 4], g: [T; 6]) -> ([T; 3], [T; 4]) {
    let (r, norm) = rotation_matrix(rotation);
    let scale = log_scale.map(|s| s.exp());
    let two = T::of(2.0);
    let full = [[g[0], g[1], g[2]], [g[1], g[3], g[4]], [g[2], g[4], g[5]]];
    // With L = R S: dL/dL = 2 G L.
    let by_l: [[T; 3]; 3] = std::array::from_fn(|i| {
        std::array::from_fn(|j| two * (0..3).map(|k| full[i][k] * r[k][j] * scale[j]).sum::<T>())
    });
    let by_log_scale: [T; 3] =
        std::array::from_fn(|j| scale[j] * (0..3).map(|i| r[i][j] * by_l[i][j]).sum::<T>());
    let m: [[T; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| by_l[i][j] * scale[j]));
    let [w, x, y, z] = rotation.map(|v| v / norm);
    let by_unit = [
        two * (x * (m[2][1] - m[1][2]) + y * (m[0][2] - m[2][0]) + z * (m[1][0] - m[0][1])),
        two * (w * (m[2][1] - m[1][2]) + y * (m[0][1] + m[1][0]) + z * (m[0][2] + m[2][0])
            - two * x * (m[1][1] + m[2][2])),
        two * (w * (m[0][2] - m[2][0]) + x * (m[0][1] + m[1][0]) + z * (m[1][2] + m[2][1])
            - two * y * (m[0][0] + m[2][2])),
        two * (w * (m[1][0] - m[0][1]) + x * (m[0][2] + m[2][0]) + y * (m[1][2] + m[2][1])
            - two * z * (m[0][0] + m[1][1])),
    ];
    let unit = [w, x, y, z];
    let along: T = (0..4).map(|k| unit[k] * by_unit[k]).sum();
    (by_log_scale, std::array::from_fn(|k| (by_unit[k] - unit[k] * along) / norm))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_put_the_highest_first() {
        let mut heights = vec![3.0f32, -2.0, 0.0, -7.5, 100.0];
        heights.sort_by_key(|h| descending_key(*h));
        assert_eq!(heights, [100.0, 3.0, 0.0, -2.0, -7.5]);
    }

    #[test]
    fn covariance_gradient_agrees_with_central_differences() {
        let (s, q) = ([-0.3, 0.4, 0.1], [0.8, -0.3, 0.5, 0.2]);
        let g = [0.3, -0.2, 0.5, 0.7, 0.1, -0.4];
        // Off-diagonal elements count twice, once for each place in the matrix.
        let weight = [1.0, 2.0, 2.0, 1.0, 2.0, 1.0];
        let loss = |s, q| -> f64 { (0..6).map(|k| weight[k] * g[k] * covariance(s, q)[k]).sum() };
        let (by_s, by_q) = covariance_gradient(s, q, g);
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
