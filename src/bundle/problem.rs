//! The adjustment as a least-squares problem: what is unknown, what was observed, residuals and derivatives.
//!
//! Unknown are a shift of each view (`corrected = rpc + shift`, pixels) and each point's place, in metres east,
//! north and up of the scene's centre: a rescaling of geodetic coordinates, so that the chain rule is a diagonal
//! matrix. The shifts' priors fix the datum; beyond a pixel they are linear, so that one bad view
//! cannot move it.

use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use rayon::prelude::*;

/// Standard deviation of a keypoint, pixels.
pub const SIGMA_PX: f64 = 0.3;
/// Standard deviation of a view's shift, and the shift from which its prior is linear, pixels.
///
/// Tighter than vendors' pointing: along the datum's three free directions, thousands of observations with their
/// small systematic errors would otherwise outweigh the priors and carry the scene off. Across them the priors'
/// pull is below 0.001 px.
const PRIOR_SIGMA_PX: f64 = 1.0;
const PRIOR_SCALE_PX: f64 = 1.0;

/// An observed image position.
#[derive(Clone, Copy, Debug)]
pub struct Measurement {
    /// Index of the view.
    pub view: usize,
    /// Where the point was seen.
    pub px: Pixel<CenterPx>,
    /// How much it counts: 1 for a good observation.
    pub weight: f64,
}

/// Shifts and points.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    /// (column, row) of each view, pixels.
    pub shifts: Vec<[f64; 2]>,
    /// (east, north, up) of each track, metres from the centre.
    pub points: Vec<[f64; 3]>,
}

/// Observations and what weighs them.
pub struct Block<'a> {
    /// Cameras as delivered.
    pub rpcs: Vec<&'a Rpc>,
    /// Observations of each track.
    pub tracks: Vec<Vec<Measurement>>,
    /// Scale of Cauchy's loss, pixels.
    pub loss_scale_px: f64,
    /// Whether the shifts are unknown.
    pub shifts_free: bool,
    center: Point<Geodetic>,
    /// Degrees of longitude, degrees of latitude and metres of height a metre is.
    per_metre: [f64; 3],
}

/// Residual of an observation (observed minus predicted, pixels), its derivative by the point (of the prediction,
/// pixels per metre), and the weight of the robust loss.
#[derive(Clone, Copy, Debug)]
pub struct Linearised {
    pub residual: [f64; 2],
    pub by_point: [[f64; 3]; 2],
    pub weight: f64,
}

impl<'a> Block<'a> {
    /// A problem around `center`.
    #[must_use]
    pub fn new(rpcs: Vec<&'a Rpc>, tracks: Vec<Vec<Measurement>>, center: Point<Geodetic>) -> Self {
        // Radii of curvature of WGS 84.
        let (a, e2) = (6_378_137.0, 0.006_694_379_990_14);
        let latitude = center.lat_deg().to_radians();
        let w2 = 1.0 - e2 * latitude.sin().powi(2);
        let across = a / w2.sqrt() + center.height_m();
        let along = a * (1.0 - e2) / w2.powf(1.5) + center.height_m();
        let per_metre = [(1.0 / (across * latitude.cos())).to_degrees(), (1.0 / along).to_degrees(), 1.0];
        Self { rpcs, tracks, loss_scale_px: 1.0, shifts_free: true, center, per_metre }
    }

    /// Geodetic coordinates of a point.
    #[must_use]
    pub fn geodetic(&self, p: [f64; 3]) -> Point<Geodetic> {
        let c = self.center.xyz();
        let [x, y, z] = std::array::from_fn(|k| c[k] + p[k] * self.per_metre[k]);
        Point::new(x, y, z)
    }

    /// Metres from the centre of a geodetic point.
    #[must_use]
    pub fn local(&self, p: Point<Geodetic>) -> [f64; 3] {
        let (c, p) = (self.center.xyz(), p.xyz());
        std::array::from_fn(|k| (p[k] - c[k]) / self.per_metre[k])
    }

    /// Residual, derivative and weight of one observation.
    #[must_use]
    pub fn linearise(&self, m: &Measurement, shift: [f64; 2], point: [f64; 3]) -> Linearised {
        let (seen, jacobian) = self.rpcs[m.view].project_with_jacobian(self.geodetic(point));
        let residual = [m.px.col - seen.col - shift[0], m.px.row - seen.row - shift[1]];
        let by_point = jacobian.map(|row| std::array::from_fn(|k| row[k] * self.per_metre[k]));
        let square = residual[0] * residual[0] + residual[1] * residual[1];
        let scale2 = self.loss_scale_px * self.loss_scale_px;
        let weight = m.weight / (1.0 + square / scale2) / (SIGMA_PX * SIGMA_PX);
        Linearised { residual, by_point, weight }
    }

    /// Distance of the prediction from an observation, pixels.
    #[must_use]
    pub fn distance(&self, m: &Measurement, shift: [f64; 2], point: [f64; 3]) -> f64 {
        let seen = self.rpcs[m.view].project(self.geodetic(point));
        Pixel::<CenterPx>::new(seen.col + shift[0], seen.row + shift[1]).distance(m.px)
    }

    /// The robust cost: half Cauchy's loss over the observations, plus the priors'.
    #[must_use]
    pub fn cost(&self, u: &Unknowns) -> f64 {
        let scale2 = self.loss_scale_px * self.loss_scale_px;
        let per_track: Vec<f64> = self
            .tracks
            .par_iter()
            .zip(&u.points)
            .with_min_len(64)
            .map(|(track, p)| {
                let loss = |m: &Measurement| {
                    let d = self.distance(m, u.shifts[m.view], *p);
                    m.weight * (d * d / scale2).ln_1p()
                };
                track.iter().map(loss).sum::<f64>()
            })
            .collect();
        let observed = 0.5 * scale2 / (SIGMA_PX * SIGMA_PX) * per_track.iter().sum::<f64>();
        observed + u.shifts.iter().map(|s| prior_cost(*s)).sum::<f64>()
    }
}

/// A shift's prior: quadratic near zero, then linear, so that one view's large shift pulls no harder than any other's.
fn prior_cost(s: [f64; 2]) -> f64 {
    let scale2 = PRIOR_SCALE_PX * PRIOR_SCALE_PX;
    let square = (s[0] * s[0] + s[1] * s[1]) / scale2;
    scale2 / (PRIOR_SIGMA_PX * PRIOR_SIGMA_PX) * ((1.0 + square).sqrt() - 1.0)
}

/// Weight of a shift's prior.
#[must_use]
pub fn prior_weight(s: [f64; 2]) -> f64 {
    let square = (s[0] * s[0] + s[1] * s[1]) / (PRIOR_SCALE_PX * PRIOR_SCALE_PX);
    1.0 / (1.0 + square).sqrt() / (PRIOR_SIGMA_PX * PRIOR_SIGMA_PX)
}
