//! An RPC fitted to any camera by least squares: what vendors do with their rigorous models.
//!
//! Per axis the weighted linear problem `min Σ w² (num - t den)²`, den's constant 1, is solved by QR with a small
//! ridge stacked below, and repeated with `w = 1 / den` until the weights stand still.

use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::rpc::{Axis, Rpc, RpcCoefficients, RpcError};
use nalgebra::{DMatrix, DVector};

/// Terms of a cubic polynomial in three variables.
const TERMS: usize = 20;
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
pub(super) struct Volume {
    pub(super) lon: Axis,
    pub(super) lat: Axis,
    pub(super) height: Axis,
    pub(super) col: Axis,
    pub(super) row: Axis,
}

/// Fits an RPC to `camera` over a volume.
pub(super) fn fit_rpc(
    volume: &Volume,
    camera: impl Fn(Point<Geodetic>) -> Pixel<CenterPx>,
) -> Result<Rpc, RpcError> {
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
    pub(super) fn ground(&self, [l, p, h]: [f64; 3]) -> Point<Geodetic> {
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

/// The twenty terms in RPC00B's order, written out a second time so that a permuted term shows.
fn monomials([l, p, h]: [f64; 3]) -> [f64; TERMS] {
    let powers: [[i32; 3]; TERMS] = [
        [0, 0, 0],
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
        [1, 1, 0],
        [1, 0, 1],
        [0, 1, 1],
        [2, 0, 0],
        [0, 2, 0],
        [0, 0, 2],
        [1, 1, 1],
        [3, 0, 0],
        [1, 2, 0],
        [1, 0, 2],
        [2, 1, 0],
        [0, 3, 0],
        [0, 1, 2],
        [2, 0, 1],
        [0, 2, 1],
        [0, 0, 3],
    ];
    powers.map(|[i, j, k]| l.powi(i) * p.powi(j) * h.powi(k))
}
