//! The camera of a view that fits an RPC best over a box of ground, by linear least squares.

use super::ViewCamera;
use crate::frame::{CenterPx, Pixel, Point, Site, SiteBox, SiteGrid};
use crate::rpc::Rpc;
use nalgebra::{DMatrix, Matrix3, Vector3};

/// The degree of a polynomial of (east, north, up).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Degree 1: four coefficients for each image axis.
    Affine,
    /// Degree 2: ten coefficients for each image axis.
    Quadratic,
}

/// Number of grid points along east, north and up of a box of ground.
const NODES: [usize; 3] = [9, 9, 7];

/// A fitted camera and its distances from the RPC.
#[derive(Clone, Copy, Debug)]
pub struct CameraFit {
    /// The camera.
    pub camera: ViewCamera,
    /// Root mean square distance to the projection of the RPC, pixels.
    pub rms_px: f64,
    /// Largest distance to the projection of the RPC, pixels.
    pub max_px: f64,
}

impl CameraFit {
    /// The camera with its distances from the pixels at which the RPC shows points.
    fn new(camera: ViewCamera, samples: &[(Point<Site>, Pixel<CenterPx>)]) -> Self {
        let errors: Vec<f64> = samples.iter().map(|(p, px)| camera.project(*p).distance(*px)).collect();
        let rms_px = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        Self { camera, rms_px, max_px: errors.into_iter().fold(0.0, f64::max) }
    }
}

/// Why no camera could be fitted.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FitError {
    /// A point lies outside of UTM.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Place(#[from] crate::frame::FrameError),
    /// The range of heights or the area is empty, or the RPC is not defined in them.
    #[error("no camera can be fitted over heights from {low_m} m to {high_m} m")]
    Degenerate {
        /// Lowest height, metres.
        low_m: f64,
        /// Highest height, metres.
        high_m: f64,
    },
}

/// Fits a camera of the given order to an RPC over a box of ground: an area of a site and altitudes above its origin.
///
/// # Errors
/// [`FitError::Degenerate`] when the box has no extent, or when the RPC is not defined in it.
pub fn fit(
    rpc: &Rpc,
    (west, south, east, north): SiteBox,
    (low, high): (f64, f64),
    site: &SiteGrid,
    order: Order,
) -> Result<CameraFit, FitError> {
    let ground = site.origin.z();
    let degenerate = || FitError::Degenerate { low_m: ground + low, high_m: ground + high };
    let (first, last) = (Vector3::new(west, south, low), Vector3::new(east, north, high));
    let (middle, half) = (0.5 * (first + last), 0.5 * (last - first));
    if !half.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(degenerate());
    }
    // In units of half the box, all terms are of the same size.
    let terms = |t: Vector3<f64>| {
        let [x, y, z] = [t.x, t.y, t.z];
        [1.0, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z]
    };
    let unknowns = match order {
        Order::Affine => 4,
        Order::Quadratic => 10,
    };
    let count = NODES.iter().product();
    let (mut design, mut right) = (DMatrix::zeros(count, unknowns), DMatrix::zeros(count, 2));
    let mut samples = Vec::with_capacity(count);
    for i in 0..count {
        let index = [i % NODES[0], i / NODES[0] % NODES[1], i / (NODES[0] * NODES[1])];
        let t = Vector3::from_fn(|k, _| 2.0 * index[k] as f64 / (NODES[k] - 1) as f64 - 1.0);
        let place = middle + half.component_mul(&t);
        let p = Point::new(place.x, place.y, place.z);
        let px: Pixel<CenterPx> = rpc.project(site.geodetic_from_site(p));
        design.row_mut(i).copy_from_slice(&terms(t)[..unknowns]);
        right.row_mut(i).copy_from_slice(&[px.col, px.row]);
        samples.push((p, px));
    }
    let qr = design.qr();
    qr.q_tr_mul(&mut right);
    let solution = qr.r().solve_upper_triangular(&right.rows(0, unknowns)).ok_or_else(degenerate)?;
    if !solution.iter().all(|v| v.is_finite()) {
        return Err(degenerate());
    }
    let mut camera = ViewCamera::affine([[0.0; 3]; 2], [0.0; 2]);
    for axis in 0..2 {
        let c = |k: usize| if k < unknowns { solution[(k, axis)] } else { 0.0 };
        // From powers of (p - middle) / half to powers of p.
        let linear = Vector3::new(c(1), c(2), c(3)).component_div(&half);
        let [xy, xz, yz] = [c(5), c(6), c(8)].map(|v| 0.5 * v);
        let square =
            Matrix3::new(c(4), xy, xz, xy, c(7), yz, xz, yz, c(9)).component_div(&(half * half.transpose()));
        camera.offset[axis] = c(0) - linear.dot(&middle) + middle.dot(&(square * middle));
        camera.linear[axis] = (linear - 2.0 * (square * middle)).into();
        let twice = |i: usize, j: usize| 2.0 * square[(i, j)];
        camera.quadratic[axis] =
            [square[(0, 0)], twice(0, 1), twice(0, 2), square[(1, 1)], twice(1, 2), square[(2, 2)]];
    }
    Ok(CameraFit::new(camera, &samples))
}
