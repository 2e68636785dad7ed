//! An RPC fitted to any camera by least squares: what vendors do with their rigorous models.
//!
//! Per axis the weighted linear problem `min Σ w² (num - t den)²`, den's constant 1, is solved by QR with a small
//! ridge stacked below, and repeated with `w = 1 / den` until the weights stand still.

use super::model::{TERMS, monomials};
use super::{Axis, Rpc, RpcCoefficients, RpcError};
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use nalgebra::{DMatrix, DVector};

/// Free coefficients per axis: 20 above, 19 below the line.
const UNKNOWNS: usize = 2 * TERMS - 1;
/// Weight of the pull towards zero; keeps the nearly dependent terms small at no cost in precision.
const RIDGE: f64 = 1e-6;
/// Nodes along each axis of the ground volume.
const NODES: usize = 12;
/// Rounds of reweighting; the denominators differ from 1 by so little that two would do.
const ROUNDS: usize = 3;

/// The ground volume and image for which a model is fitted.
#[derive(Clone, Copy, Debug)]
pub struct Volume {
    /// Longitude, degrees.
    pub lon: Axis,
    /// Latitude, degrees.
    pub lat: Axis,
    /// Ellipsoidal height, metres.
    pub height: Axis,
    /// Column, pixels.
    pub col: Axis,
    /// Row, pixels.
    pub row: Axis,
}

/// The RPC nearest to `camera` over a volume; it agrees with another RPC there to 1e-6 px.
///
/// # Errors
/// [`RpcError`] when no model without poles is found.
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
    /// The ground point of normalised coordinates (longitude, latitude, height).
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
    fn a_refit_over_half_the_heights_is_the_same_camera_there() {
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
