//! Normals of the points of a cloud.

use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use std::num::NonZero;

/// Unit normals of the planes through each point's `neighbours` nearest ones, the point itself among them, in the sense of least
/// squares. They have no side.
#[must_use]
pub fn point_normals(points: &[[f64; 3]], neighbours: NonZero<usize>) -> Vec<DVec3> {
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(points);
    let Ok(tree) = tree else { return vec![DVec3::Z; points.len()] };
    let normal = |p: &[f64; 3]| {
        let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(neighbours).execute();
        let near: Vec<Vector3<f64>> = near.iter().map(|n| Vector3::from(points[n.item as usize])).collect();
        let mean = near.iter().sum::<Vector3<f64>>() / near.len() as f64;
        let spread: Matrix3<f64> = near.iter().map(|q| (q - mean) * (q - mean).transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        let across = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        DVec3::new(across[0], across[1], across[2]).try_normalize().unwrap_or(DVec3::Z)
    };
    points.par_iter().map(normal).collect()
}
