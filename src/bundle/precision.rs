//! Precision of an adjustment: standard deviations of corrections and points, and the rank defect of the normal
//! equations.
//!
//! The reduced normal matrix of all observations contains no priors. Eigenvectors with eigenvalues below those of the
//! priors are combinations of corrections that only the priors determine; without ground control or reference views
//! these are the translations of the whole scene. The covariance is the pseudo-inverse without these eigenvectors (a
//! free network, Förstner & Wrobel 2016, section 4.5): it describes the precision within the scene for a given datum.

use super::correction::{CorrectionModel, MOST, Parameters, by_parameters};
use super::problem::{Block, SIGMA_PX, Unknowns};
use super::solver::{Normal, jacobian};
use nalgebra::{DMatrix, Matrix3, SMatrix, SymmetricEigen};
use rayon::prelude::*;

/// Precision of an adjustment.
#[derive(Clone, Debug, PartialEq)]
pub struct Precision {
    /// A posteriori standard deviation of an observation of weight 1, pixels.
    pub sigma_px: f64,
    /// Rank defect: number of combinations of corrections that the observations do not determine.
    pub rank_defect: usize,
    /// Standard deviations of the corrections of each view, pixels.
    pub corrections: Vec<Parameters>,
    /// Standard deviations of each point, metres east, north and up.
    pub points: Vec<[f64; 3]>,
}

impl Precision {
    /// Precision of a solution; none if the rays of a point do not determine it.
    #[must_use]
    pub fn of(block: &Block, at: &Unknowns) -> Option<Self> {
        match block.model {
            CorrectionModel::Shift => Self::with::<2>(block, at),
            CorrectionModel::ShiftScale => Self::with::<4>(block, at),
            CorrectionModel::Affine => Self::with::<MOST>(block, at),
        }
    }

    fn with<const P: usize>(block: &Block, at: &Unknowns) -> Option<Self> {
        let normal = Normal::new(block, at);
        let points = normal.eliminated(block, at, 0.0)?;
        let views = at.corrections.len();
        let free: Vec<usize> = (0..P * views).filter(|i| !block.is_fixed[i / P]).collect();
        // Scales that make the standard deviations of the priors 1.
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
            // A point changes by -V⁻¹ Wᵀ times the change of the corrections.
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

/// The number of eigenvalues below 1, and the pseudo-inverse without their eigenvectors.
fn pseudo_inverse(matrix: DMatrix<f64>) -> (usize, DMatrix<f64>) {
    if matrix.is_empty() {
        return (0, matrix);
    }
    let eigen = SymmetricEigen::new(matrix);
    let open = eigen.eigenvalues.iter().filter(|l| **l < 1.0).count();
    let inverse = eigen.eigenvalues.map(|l| if l < 1.0 { 0.0 } else { 1.0 / l });
    (open, &eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose())
}

/// Variance factor: weighted sum of squared residuals over the redundancy. Only tracks of full weight count, because
/// unconfirmed keypoints would add redundancy without weight.
fn variance_factor(block: &Block, normal: &Normal, parameters: usize) -> f64 {
    let (mut square, mut redundancy) = (0.0, -(parameters as f64));
    for (track, seen) in block.tracks.iter().zip(&normal.observations) {
        if track.prior.is_some() || track.observations.iter().any(|m| m.weight < 1.0) {
            continue;
        }
        redundancy += 2.0 * seen.len() as f64 - 3.0;
        square += seen.iter().map(|o| o.weight * o.residual.iter().map(|r| r * r).sum::<f64>()).sum::<f64>();
    }
    // Without redundancy the residuals say nothing, and the a priori standard deviation is kept.
    if redundancy >= 1.0 { square / redundancy } else { 1.0 }
}
