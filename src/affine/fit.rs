//! The affine camera that fits an RPC best over an image and a range of heights, by linear least squares.

use super::ViewCamera;
use crate::frame::{Pixel, SiteGrid};
use crate::rpc::{LocalizeError, Rpc};
use nalgebra::{Matrix4, Vector4};

/// Number of grid points along columns, rows and heights.
const NODES: [usize; 3] = [15, 15, 7];

/// A fitted camera and its distances from the RPC.
#[derive(Clone, Copy, Debug)]
pub struct AffineFit {
    /// The camera.
    pub camera: ViewCamera,
    /// Root mean square distance to the projection of the RPC, pixels.
    pub rms_px: f64,
    /// Largest distance to the projection of the RPC, pixels.
    pub max_px: f64,
}

/// Why no affine camera could be fitted.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FitError {
    /// The RPC has no inverse in the volume that the image shows.
    #[error("the RPC cannot be inverted over the image")]
    #[diagnostic(help("check that the RPC belongs to this image"))]
    Localize(#[from] LocalizeError),
    /// A point lies outside of UTM.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Place(#[from] crate::frame::FrameError),
    /// The range of heights is empty, or the camera looks along the ground.
    #[error("no affine camera can be fitted over heights from {low_m} m to {high_m} m")]
    Degenerate {
        /// Lowest height, metres.
        low_m: f64,
        /// Highest height, metres.
        high_m: f64,
    },
}

/// Fits an affine camera to an RPC over an image of `width` x `height` pixels and ellipsoidal heights
/// `low_m..high_m`.
///
/// # Errors
/// [`FitError`] when the RPC cannot be inverted, or when the points do not determine an affine camera.
pub fn fit(
    rpc: &Rpc,
    (width, height): (usize, usize),
    (low_m, high_m): (f64, f64),
    site: &SiteGrid,
) -> Result<AffineFit, FitError> {
    let degenerate = || FitError::Degenerate { low_m, high_m };
    let node = |i: usize, n: usize, lo: f64, hi: f64| lo + (hi - lo) * i as f64 / (n - 1) as f64;
    let mut samples = Vec::with_capacity(NODES.iter().product());
    for k in 0..NODES[2] {
        let h = node(k, NODES[2], low_m, high_m);
        for j in 0..NODES[1] {
            for i in 0..NODES[0] {
                let px = Pixel::new(
                    node(i, NODES[0], 0.0, width as f64 - 1.0),
                    node(j, NODES[1], 0.0, height as f64 - 1.0),
                );
                samples.push((site.site_from_geodetic(rpc.localize(px, h)?), px));
            }
        }
    }
    // East and north have a far larger range than up. The normal equations are solved in units of each range.
    let range: [f64; 3] =
        std::array::from_fn(|a| samples.iter().map(|(p, _)| p.xyz()[a].abs()).fold(1e-3, f64::max));
    let row = |p: [f64; 3]| Vector4::new(p[0] / range[0], p[1] / range[1], p[2] / range[2], 1.0);
    let mut normal = Matrix4::zeros();
    let mut right = [Vector4::zeros(), Vector4::zeros()];
    for (p, px) in &samples {
        let r = row(p.xyz());
        normal += r * r.transpose();
        right[0] += r * px.col;
        right[1] += r * px.row;
    }
    let factor = normal.cholesky().ok_or_else(degenerate)?;
    let solution = right.map(|b| factor.solve(&b));
    let camera = ViewCamera::affine(
        std::array::from_fn(|i| std::array::from_fn(|a| solution[i][a] / range[a])),
        [solution[0][3], solution[1][3]],
    );
    if !camera.linear.as_flattened().iter().all(|v| v.is_finite()) {
        return Err(degenerate());
    }
    let errors: Vec<f64> = samples.iter().map(|(p, px)| camera.project(*p).distance(*px)).collect();
    let rms_px = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    Ok(AffineFit { camera, rms_px, max_px: errors.into_iter().fold(0.0, f64::max) })
}
