//! The error of polynomial approximations of an RPC over a box of ground, such as that of an affine camera.

use super::{CameraFit, FitError, Order, fit};
use crate::frame::{Geodetic, Point, SiteGrid};
use crate::rpc::Rpc;

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
    let (half, half_height) = (0.5 * ground.side_m, ground.half_height_m);
    let site = SiteGrid::at(ground.center)?;
    let area = (-half, -half, half, half);
    let CameraFit { rms_px, max_px, .. } = fit(rpc, area, (-half_height, half_height), &site, order)?;
    Ok(Residual { rms_px, max_px })
}
