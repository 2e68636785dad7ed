//! Splats merged by the cells of a grid.

use crate::splat::splats::{Splats, logit, sigmoid, unit_quaternion};
use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix3, SymmetricEigen};

/// Largest opacity of a merged splat.
const MOST_OPAQUE: f64 = 0.99;
/// A merged splat may grow by this factor to cover what the merged ones covered with opacities below one.
const MOST_GROWN: f64 = 1.5;
/// Smallest standard deviation, metres: discs are not thinner once merged.
const THINNEST_M: f64 = 1e-4;

/// Merges the splats of each cell of a grid of cubes with this side, counted from `origin`: means and covariances are those of
/// the mixture, weighted by opacity and area, as are colours (moment matching, as in Kerbl et al. 2024, "A Hierarchical 3D
/// Gaussian Representation", section 4.2). Opacity times area is kept. A splat alone in its cell stays as it is.
#[must_use]
pub fn merge(splats: &Splats, origin: [f32; 3], cell: f32) -> Splats {
    let key =
        |p: &[f32; 3]| -> [i64; 3] { std::array::from_fn(|k| ((p[k] - origin[k]) / cell).floor() as i64) };
    let mut order: Vec<([i64; 3], u32)> = splats.position.iter().map(key).zip(0..).collect();
    order.sort_unstable();
    let mut merged = Splats::default();
    for group in order.chunk_by(|a, b| a.0 == b.0) {
        let mut one = Splats::default();
        if let [(_, i)] = group {
            one.take_from(splats, &[*i]);
        } else {
            one.take_from(splats, &[group[0].1]);
            into_one(splats, group.iter().map(|(_, i)| *i as usize), &mut one);
        }
        merged.append(one);
    }
    merged
}

/// Splat `i` as moments: its mean and covariance, its opacity times area, and its two largest standard deviations' product.
fn moments(splats: &Splats, i: usize) -> (DVec3, DMat3, f64) {
    let [w, x, y, z] = unit_quaternion(splats.rotation[i]).map(f64::from);
    let axes = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w));
    let scale = splats.log_scale[i].map(|s| f64::from(s).exp());
    let spread = axes * DMat3::from_diagonal(DVec3::from_array(scale));
    let opacity = f64::from(sigmoid(splats.opacity_logit[i][0]));
    (DVec3::from_array(splats.position[i].map(f64::from)), spread * spread.transpose(), opacity * area(scale))
}

/// The area of a splat seen from its broadest side, but for a factor.
fn area([a, b, c]: [f64; 3]) -> f64 {
    a * b * c / a.min(b).min(c)
}

/// Writes the splat of these members into `one`.
fn into_one(splats: &Splats, members: impl Iterator<Item = usize> + Clone, one: &mut Splats) {
    let weight_of = |i: usize| moments(splats, i).2.max(f64::MIN_POSITIVE);
    let total: f64 = members.clone().map(weight_of).sum();
    let mean: DVec3 = members.clone().map(|i| moments(splats, i).0 * (weight_of(i) / total)).sum();
    let mut covariance = DMat3::ZERO;
    let (mut f_dc, mut f_rest) = ([0.0f64; 3], [0.0f64; 45]);
    for i in members {
        let (position, own, _) = moments(splats, i);
        let (share, d) = (weight_of(i) / total, position - mean);
        covariance += (own + DMat3::from_cols(d * d.x, d * d.y, d * d.z)) * share;
        let rest = splats.f_rest.get(i).map_or(&[][..], |rest| rest);
        for (sum, value) in f_dc.iter_mut().zip(splats.f_dc[i]).map(|(s, v)| (s, f64::from(v))) {
            *sum += share * value;
        }
        for (sum, value) in f_rest.iter_mut().zip(rest) {
            *sum += share * f64::from(*value);
        }
    }
    let eigen = SymmetricEigen::new(Matrix3::from_fn(|r, c| covariance.col(c)[r]));
    let mut axes: [usize; 3] = [0, 1, 2];
    axes.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let column = |k: usize| DVec3::from_array(std::array::from_fn(|r| eigen.eigenvectors[(r, axes[k])]));
    let (first, second) = (column(0), column(1));
    let rotation = DQuat::from_mat3(&DMat3::from_cols(first, second, first.cross(second))).normalize();
    let mut scale = axes.map(|k| eigen.eigenvalues[k].max(0.0).sqrt().max(THINNEST_M));
    let needed = total / (MOST_OPAQUE * area(scale));
    if needed > 1.0 {
        let growth = needed.sqrt().min(MOST_GROWN);
        scale[0] *= growth;
        scale[1] *= growth;
    }
    let opacity = (total / area(scale)).clamp(1e-6, MOST_OPAQUE);
    one.position[0] = mean.as_vec3().to_array();
    one.f_dc[0] = f_dc.map(|v| v as f32);
    one.f_rest.iter_mut().for_each(|rest| *rest = f_rest.map(|v| v as f32));
    one.opacity_logit[0] = [logit(opacity as f32)];
    one.log_scale[0] = scale.map(|s| s.ln() as f32);
    one.rotation[0] = [rotation.w, rotation.x, rotation.y, rotation.z].map(|v| v as f32);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_merged_splats_are_those_of_the_mixture() {
        let mut splats = Splats::default();
        splats.push([1.0, 1.0, 1.0], 0.1, 0.5, [0.2, 0.4, 0.6]);
        splats.push([3.0, 1.0, 1.0], 0.1, 0.5, [0.4, 0.6, 0.8]);
        splats.push([9.0, 1.0, 1.0], 0.7, 0.3, [0.1, 0.2, 0.3]);
        let merged = merge(&splats, [0.0; 3], 4.0);
        assert_eq!(
            (merged.len(), merged.position[1], merged.log_scale[1]),
            (2, [9.0, 1.0, 1.0], [0.7f32.ln(); 3])
        );
        assert_eq!(merged.position[0], [2.0, 1.0, 1.0]);
        let color = crate::splat::splats::color_from_f_dc(merged.f_dc[0]);
        assert!(color.iter().zip([0.3, 0.5, 0.7]).all(|(a, b)| (a - b).abs() < 1e-6));
        // Along x: the variance of ±1 and of each splat.
        let (_, covariance, _) = moments(&merged, 0);
        let expected = DMat3::from_diagonal(DVec3::new(1.01, 0.01, 0.01));
        assert!(covariance.abs_diff_eq(expected, 1e-5), "{covariance}");
        // Opacity times area: 2 * 0.5 * 0.01 over an area of 0.1 * sqrt(1.01).
        let opacity = sigmoid(merged.opacity_logit[0][0]);
        assert!((opacity - 0.0995).abs() < 1e-3, "{opacity}");
    }

    #[test]
    fn what_many_splats_cover_stays_covered() {
        let mut splats = Splats::default();
        for i in 0..64 {
            splats.push([(i % 8) as f32 + 0.5, (i / 8) as f32 + 0.5, 0.0], 0.6, 0.95, [0.5; 3]);
        }
        splats.flatten();
        splats.f_rest = vec![[0.25; 45]; 64];
        let merged = merge(&splats, [0.0, 0.0, -1.0], 8.0);
        assert_eq!((merged.len(), merged.f_rest[0]), (1, [0.25; 45]));
        assert!(sigmoid(merged.opacity_logit[0][0]) > 0.95);
        assert!(merged.log_scale[0][2] < -5.0 && merged.log_scale[0][0] > 2.3f32.ln());
    }
}
