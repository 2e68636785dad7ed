//! How sure an adjustment is: standard deviations of corrections and points, and what observations leave open.
//!
//! The normal matrix of all observations, with the points eliminated, is free of priors. Its eigenvectors whose values
//! are below the priors' are combinations of corrections that the priors hold, not the observations; without ground
//! control or reference views these are the translations of the whole scene. The covariance is the pseudo-inverse
//! without them (a free network, Förstner & Wrobel 2016, §4.5): precision within the scene, its datum taken as given.

use super::correction::{MOST, Model, Parameters, by_parameters};
use super::problem::{Block, SIGMA_PX, Unknowns};
use super::solver::{Normal, jacobian};
use nalgebra::{DMatrix, Matrix3, SMatrix, SymmetricEigen};
use rayon::prelude::*;

/// What an adjustment knows of its own errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// Standard deviation of an observation of full weight, after its residuals, pixels.
    pub sigma_px: f64,
    /// Independent combinations of corrections that observations leave open.
    pub rank_defect: usize,
    /// Standard deviations of each view's corrections, pixels.
    pub corrections: Vec<Parameters>,
    /// Standard deviations of each point, metres east, north and up.
    pub points: Vec<[f64; 3]>,
}

impl Precision {
    /// The precision of a solution; none if a point is not fixed by its rays.
    #[must_use]
    pub fn of(block: &Block, at: &Unknowns) -> Option<Self> {
        match block.model {
            Model::Shift => Self::with::<2>(block, at),
            Model::ShiftScale => Self::with::<4>(block, at),
            Model::Affine => Self::with::<MOST>(block, at),
        }
    }

    fn with<const P: usize>(block: &Block, at: &Unknowns) -> Option<Self> {
        let normal = Normal::new(block, at);
        let points = normal.eliminated(block, at, 0.0)?;
        let views = at.corrections.len();
        let free: Vec<usize> = (0..P * views).filter(|i| !block.is_fixed[i / P]).collect();
        // In units of the priors' standard deviations.
        let unit: Vec<f64> =
            free.iter().map(|i| block.prior_weights(i / P, &[0.0; MOST])[i % P].powf(-0.5)).collect();
        let reduced = normal.reduced::<P>(block, &points).matrix;
        let scaled =
            DMatrix::from_fn(free.len(), free.len(), |i, j| unit[i] * reduced[(free[i], free[j])] * unit[j]);
        let (open, inverse) = pseudo_inverse(scaled);
        let variance = variance_factor(block, &normal, free.len() - open);
        let mut covariance = DMatrix::zeros(P * views, P * views);
        for (a, i) in free.iter().enumerate() {
            for (b, j) in free.iter().enumerate() {
                covariance[(*i, *j)] = variance * unit[a] * inverse[(a, b)] * unit[b];
            }
        }
        let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
        let of_view = |v: usize| std::array::from_fn(|k| if k < P { sigma(P * v + k) } else { 0.0 });
        let of_point = |(t, e): (usize, &super::solver::Eliminated)| {
            // The point moves by -V⁻¹ Wᵀ times the corrections.
            let parts: Vec<(usize, SMatrix<f64, 3, P>)> = block.tracks[t]
                .observations
                .iter()
                .zip(&normal.observations[t])
                .map(|(m, o)| {
                    let w = jacobian(o).transpose() * by_parameters::<P>(o.at) * o.weight;
                    (P * m.view, e.inverse.solve(&w))
                })
                .collect();
            let mut total: Matrix3<f64> = e.inverse.inverse() * variance;
            for (i, a) in &parts {
                for (j, b) in &parts {
                    total += a * covariance.fixed_view::<P, P>(*i, *j) * b.transpose();
                }
            }
            std::array::from_fn(|k| total[(k, k)].max(0.0).sqrt())
        };
        Some(Self {
            sigma_px: SIGMA_PX * variance.sqrt(),
            rank_defect: open,
            corrections: (0..views).map(of_view).collect(),
            points: points.par_iter().enumerate().with_min_len(64).map(of_point).collect(),
        })
    }
}

/// The inverse without the eigenvectors whose values are below one, and the number of these.
fn pseudo_inverse(matrix: DMatrix<f64>) -> (usize, DMatrix<f64>) {
    if matrix.is_empty() {
        return (0, matrix);
    }
    let eigen = SymmetricEigen::new(matrix);
    let open = eigen.eigenvalues.iter().filter(|l| **l < 1.0).count();
    let inverse = eigen.eigenvalues.map(|l| if l < 1.0 { 0.0 } else { 1.0 / l });
    (open, &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose())
}

/// Weighted square of the residuals over the redundancy, from tracks of full weight alone: keypoints that no patch
/// confirms would count as observations and weigh nothing.
fn variance_factor(block: &Block, normal: &Normal, parameters: usize) -> f64 {
    let (mut square, mut redundancy) = (0.0, -(parameters as f64));
    for (track, seen) in block.tracks.iter().zip(&normal.observations) {
        if track.prior.is_some() || track.observations.iter().any(|m| m.weight < 1.0) {
            continue;
        }
        redundancy += 2.0 * seen.len() as f64 - 3.0;
        square += seen.iter().map(|o| o.weight * o.residual.iter().map(|r| r * r).sum::<f64>()).sum::<f64>();
    }
    // Without redundancy the residuals tell nothing, and observations are taken to be as good as assumed.
    if redundancy >= 1.0 { square / redundancy } else { 1.0 }
}
