//! The error of polynomial approximations of an RPC over a box of ground, such as that of an affine camera.

use super::FitError;
use crate::frame::{Geodetic, Pixel, Point, SiteGrid};
use crate::rpc::Rpc;
use nalgebra::{DMatrix, DVector};

/// Number of grid points along east, north and up.
const NODES: [usize; 3] = [9, 9, 7];

/// The degree of a polynomial of (east, north, up).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Degree 1: four coefficients for each image axis.
    Affine,
    /// Degree 2: ten coefficients for each image axis.
    Quadratic,
}

/// A box of ground: a square on the map, and heights around its centre.
#[derive(Clone, Copy, Debug)]
pub struct GroundBox {
    /// Its centre, at the middle of the heights.
    pub center: Point<Geodetic>,
    /// Side of the square, metres.
    pub side_m: f64,
    /// Half the range of heights, metres.
    pub half_height_m: f64,
}

/// Distances in the image between an approximation and the RPC.
#[derive(Clone, Copy, Debug)]
pub struct Residual {
    /// Root mean square distance, pixels.
    pub rms_px: f64,
    /// Largest distance, pixels.
    pub max_px: f64,
}

/// The residual of the polynomial that fits an RPC best over a box, by linear least squares.
///
/// # Errors
/// [`FitError`] if the box lies outside of UTM or has no extent.
pub fn residual(rpc: &Rpc, ground: &GroundBox, order: Order) -> Result<Residual, FitError> {
    let h = ground.center.height_m();
    let degenerate =
        || FitError::Degenerate { low_m: h - ground.half_height_m, high_m: h + ground.half_height_m };
    let half = [0.5 * ground.side_m, 0.5 * ground.side_m, ground.half_height_m];
    if !half.iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(degenerate());
    }
    let site = SiteGrid::at(ground.center)?;
    let count = NODES.iter().product();
    let terms = |[x, y, z]: [f64; 3]| [1.0, x, y, z, x * y, x * z, y * z, x * x, y * y, z * z];
    let unknowns = match order {
        Order::Affine => 4,
        Order::Quadratic => 10,
    };
    let mut design = DMatrix::zeros(count, unknowns);
    let (mut cols, mut rows) = (DVector::zeros(count), DVector::zeros(count));
    for i in 0..count {
        let index = [i % NODES[0], i / NODES[0] % NODES[1], i / (NODES[0] * NODES[1])];
        let node: [f64; 3] = std::array::from_fn(|k| 2.0 * index[k] as f64 / (NODES[k] - 1) as f64 - 1.0);
        let place = Point::new(node[0] * half[0], node[1] * half[1], node[2] * half[2]);
        let px: Pixel<_> = rpc.project(site.geodetic_from_site(place));
        (cols[i], rows[i]) = (px.col, px.row);
        design.row_mut(i).copy_from_slice(&terms(node)[..unknowns]);
    }
    let qr = design.clone().qr();
    let rest = |b: &DVector<f64>| {
        let mut projected = b.clone();
        qr.q_tr_mul(&mut projected);
        let x = qr.r().solve_upper_triangular(&projected.rows(0, unknowns))?;
        Some(b - &design * x)
    };
    let (col, row) = rest(&cols).zip(rest(&rows)).ok_or_else(degenerate)?;
    let squares: Vec<f64> = col.iter().zip(&row).map(|(c, r)| c * c + r * r).collect();
    let mean = squares.iter().sum::<f64>() / count as f64;
    if !mean.is_finite() {
        return Err(degenerate());
    }
    Ok(Residual { rms_px: mean.sqrt(), max_px: squares.into_iter().fold(0.0, f64::max).sqrt() })
}
