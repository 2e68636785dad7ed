//! Fit of an RPC to any camera by linear least squares, as vendors fit RPCs to their rigorous sensor models.
//!
//! For each image axis, the weighted linear problem `min Σ w² (num - t den)²`, in which the constant of `den` is 1, is
//! solved by QR decomposition with ridge regularisation. It is solved repeatedly with `w = 1 / den` of the previous
//! solution. Reference: Tao and Hu (2001), "A comprehensive study of the rational function model", iterative solution.

use super::model::{TERMS, monomials};
use super::{Axis, Rpc, RpcCoefficients, RpcError};
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use nalgebra::{DMatrix, DVector};

/// Free coefficients per image axis: 20 of the numerator, 19 of the denominator.
const UNKNOWNS: usize = 2 * TERMS - 1;
/// Ridge weight. It keeps the coefficients of nearly dependent terms small and costs no precision.
const RIDGE: f64 = 1e-6;
/// Nodes along each axis of the ground volume.
const NODES: usize = 12;
/// Number of reweighted solutions. The denominators are so near to 1 that two would suffice.
const ROUNDS: usize = 3;

/// The ground volume and the image over which an RPC is fitted; their offsets and scales become those of the RPC.
#[derive(Clone, Copy, Debug)]
pub struct Volume {
    /// WGS 84 longitude, degrees.
    pub lon: Axis,
    /// WGS 84 latitude, degrees.
    pub lat: Axis,
    /// Height above the WGS 84 ellipsoid, metres.
    pub height: Axis,
    /// Column, pixels; 0 is the centre of the first pixel.
    pub col: Axis,
    /// Row, pixels; 0 is the centre of the first pixel.
    pub row: Axis,
}

/// Fits an RPC to `camera`, a projection from ground to image, over a volume. A fit to another RPC agrees with it to
/// 1e-6 px.
///
/// # Errors
/// [`RpcError`] if the fitted model is not a valid RPC, for example because a denominator changes sign.
pub fn fit(volume: &Volume, camera: impl Fn(Point<Geodetic>) -> Pixel<CenterPx>) -> Result<Rpc, RpcError> {
    let chebyshev = |i: usize| (std::f64::consts::PI * (i as f64 + 0.5) / NODES as f64).cos();
    let mut terms = Vec::with_capacity(NODES * NODES * NODES);
    let (mut cols, mut rows) = (Vec::new(), Vec::new());
    for i in 0..NODES.pow(3) {
        let node = [chebyshev(i % NODES), chebyshev(i / NODES % NODES), chebyshev(i / (NODES * NODES))];
        let px = camera(volume.ground(node));
        terms.push(monomials(node));
        cols.push((px.col - volume.col.offset) / volume.col.scale);
        rows.push((px.row - volume.row.offset) / volume.row.scale);
    }
    let (col_num, col_den) = fit_axis(&terms, &cols);
    let (row_num, row_den) = fit_axis(&terms, &rows);
    Rpc::new(RpcCoefficients {
        col: volume.col,
        row: volume.row,
        lon: volume.lon,
        lat: volume.lat,
        height: volume.height,
        col_num,
        col_den,
        row_num,
        row_den,
        err_bias_m: None,
        err_rand_m: None,
    })
}

impl Volume {
    /// The ground point of normalised coordinates (longitude, latitude, height) in [-1, 1].
    #[must_use]
    pub fn ground(&self, [l, p, h]: [f64; 3]) -> Point<Geodetic> {
        Point::new(
            self.lon.offset + self.lon.scale * l,
            self.lat.offset + self.lat.scale * p,
            self.height.offset + self.height.scale * h,
        )
    }
}

fn fit_axis(terms: &[[f64; TERMS]], targets: &[f64]) -> ([f64; TERMS], [f64; TERMS]) {
    let n = terms.len();
    let mut den = [0.0; TERMS];
    let mut num = [0.0; TERMS];
    den[0] = 1.0;
    for _ in 0..ROUNDS {
        let mut a = DMatrix::zeros(n + UNKNOWNS, UNKNOWNS);
        let mut b = DVector::zeros(n + UNKNOWNS);
        for (i, (m, t)) in terms.iter().zip(targets).enumerate() {
            let weight = 1.0 / m.iter().zip(&den).map(|(a, b)| a * b).sum::<f64>();
            for k in 0..TERMS {
                a[(i, k)] = weight * m[k];
                if k > 0 {
                    a[(i, TERMS + k - 1)] = -weight * t * m[k];
                }
            }
            b[i] = weight * t;
        }
        for k in 0..UNKNOWNS {
            a[(n + k, k)] = RIDGE;
        }
        let qr = a.qr();
        qr.q_tr_mul(&mut b);
        let x =
            qr.r().solve_upper_triangular(&b.rows(0, UNKNOWNS)).unwrap_or_else(|| DVector::zeros(UNKNOWNS));
        num.copy_from_slice(&x.as_slice()[..TERMS]);
        den[1..].copy_from_slice(&x.as_slice()[TERMS..]);
    }
    (num, den)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rpc::test_camera;

    #[test]
    fn a_fit_to_an_rpc_agrees_with_it_to_1e_6_px() {
        let rpc = test_camera();
        let c = rpc.coefficients();
        let height = Axis { offset: c.height.offset + 20.0, scale: 0.5 * c.height.scale };
        let volume = Volume { lon: c.lon, lat: c.lat, height, col: c.col, row: c.row };
        let refitted = fit(&volume, |p| rpc.project(p)).unwrap();
        assert_ne!(refitted, rpc);
        let node = |i: i32| f64::from(i % 17) / 8.0 - 1.0;
        let apart = (0..17i32.pow(3)).map(|i| {
            let p = volume.ground([node(i), node(i / 17), node(i / 289)]);
            refitted.project(p).distance(rpc.project(p))
        });
        let worst = apart.fold(0.0, f64::max);
        assert!(worst < 1e-6, "{worst} px");
    }
}
