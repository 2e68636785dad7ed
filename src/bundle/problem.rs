//! The adjustment as a least-squares problem: what is unknown, what was observed, residuals and derivatives.
//!
//! Unknown are each view's correction and each point's place, in metres east, north and up of the scene's centre: a
//! rescaling of geodetic coordinates, so that the chain rule is a diagonal matrix. The corrections' priors fix the
//! datum; those of shifts are linear beyond a pixel, so that one bad view cannot move it.

use super::correction::{ImageFrame, MOST, Model, Parameters};
use super::height_prior::PointHeights;
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use rayon::prelude::*;

/// Standard deviation of a keypoint, pixels.
pub const SIGMA_PX: f64 = 0.3;
/// Standard deviation of a view's shift, from which its prior is linear, pixels.
///
/// Tighter than vendors' pointing: along the datum's three free directions, thousands of observations with their
/// small systematic errors would otherwise outweigh the priors and carry the scene off. Across them the priors'
/// pull is below 0.001 px.
const PRIOR_SIGMA_PX: f64 = 1.0;
/// The same where ground control fixes the datum: vendors' pointing.
const PRIOR_SIGMA_WITH_CONTROL_PX: f64 = 10.0;
/// Standard deviation of the other parameters for images up to the side below, beyond it in proportion, pixels.
///
/// Near-affine cameras that may stretch freely leave heights free to tilt and scale.
const EDGE_SIGMA_PX: f64 = 0.05;
const EDGE_SIDE_PX: f64 = 4096.0;

/// An observed image position.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the view.
    pub view: usize,
    /// Where the point was seen.
    pub px: Pixel<CenterPx>,
    /// How much it counts: 1 for a good observation.
    pub weight: f64,
}

/// What is known of a point beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionPrior {
    /// (east, north, up) of the centre, metres.
    pub place: [f64; 3],
    /// Standard deviations, metres.
    pub sigma_m: [f64; 3],
}

/// A point on the ground as views see it.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// At most one a view.
    pub observations: Vec<Observation>,
    /// What it looks like, of 255.
    pub gray: u8,
    /// What a survey tells, for ground control.
    pub prior: Option<PositionPrior>,
}

/// Corrections and points.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    /// Of each view.
    pub corrections: Vec<Parameters>,
    /// (east, north, up) of each track, metres from the centre.
    pub points: Vec<[f64; 3]>,
}

/// Observations and what weighs them.
pub struct Block<'a> {
    /// Cameras as delivered.
    pub rpcs: Vec<&'a Rpc>,
    /// Their images.
    pub frames: Vec<ImageFrame>,
    /// The points.
    pub tracks: Vec<Track>,
    /// Scale of Cauchy's loss, pixels.
    pub loss_scale_px: f64,
    /// Which parameters are unknown.
    pub model: Model,
    /// Views whose corrections stay as they are.
    pub is_fixed: Vec<bool>,
    /// What an elevation model tells of the points.
    pub heights: Option<PointHeights>,
    center: Point<Geodetic>,
    /// Degrees of longitude, degrees of latitude and metres of height a metre is.
    per_metre: [f64; 3],
}

/// Residual of an observation (observed minus predicted, pixels), its derivative by the point (of the prediction,
/// pixels per metre), where in the image it is (normalised), and the weight of the robust loss.
#[derive(Clone, Copy, Debug)]
pub struct Linearised {
    pub residual: [f64; 2],
    pub by_point: [[f64; 3]; 2],
    pub at: [f64; 2],
    pub weight: f64,
}

impl<'a> Block<'a> {
    /// A problem around `center`.
    #[must_use]
    pub fn new(rpcs: Vec<&'a Rpc>, frames: Vec<ImageFrame>, center: Point<Geodetic>) -> Self {
        // Radii of curvature of WGS 84.
        let (a, e2) = (6_378_137.0, 0.006_694_379_990_14);
        let latitude = center.lat_deg().to_radians();
        let w2 = 1.0 - e2 * latitude.sin().powi(2);
        let across = a / w2.sqrt() + center.height_m();
        let along = a * (1.0 - e2) / w2.powf(1.5) + center.height_m();
        let per_metre = [(1.0 / (across * latitude.cos())).to_degrees(), (1.0 / along).to_degrees(), 1.0];
        let is_fixed = vec![false; rpcs.len()];
        Self {
            rpcs,
            frames,
            tracks: Vec::new(),
            loss_scale_px: 1.0,
            model: Model::Shift,
            is_fixed,
            heights: None,
            center,
            per_metre,
        }
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

    /// Where a view sees a point.
    #[must_use]
    pub fn project(&self, view: usize, correction: &Parameters, point: [f64; 3]) -> Pixel<CenterPx> {
        self.frames[view].corrected_px(correction, self.rpcs[view].project(self.geodetic(point)))
    }

    /// Residual, derivative and weight of one observation.
    #[must_use]
    pub fn linearise(&self, m: &Observation, correction: &Parameters, point: [f64; 3]) -> Linearised {
        let (given, jacobian) = self.rpcs[m.view].project_with_jacobian(self.geodetic(point));
        let frame = &self.frames[m.view];
        let predicted = frame.corrected_px(correction, given);
        let residual = [m.px.col - predicted.col, m.px.row - predicted.row];
        let by_point = frame.jacobian_by_px(correction).map(|jacobian_by_px| {
            std::array::from_fn(|k| {
                (jacobian_by_px[0] * jacobian[0][k] + jacobian_by_px[1] * jacobian[1][k]) * self.per_metre[k]
            })
        });
        let square = residual[0] * residual[0] + residual[1] * residual[1];
        let scale2 = self.loss_scale_px * self.loss_scale_px;
        let weight = m.weight / (1.0 + square / scale2) / (SIGMA_PX * SIGMA_PX);
        Linearised { residual, by_point, at: frame.normalised(given), weight }
    }

    /// Distance of the prediction from an observation, pixels.
    #[must_use]
    pub fn distance(&self, m: &Observation, correction: &Parameters, point: [f64; 3]) -> f64 {
        self.project(m.view, correction, point).distance(m.px)
    }

    /// The robust cost: half Cauchy's loss over the observations, plus the priors'.
    #[must_use]
    pub fn cost(&self, u: &Unknowns) -> f64 {
        let scale2 = self.loss_scale_px * self.loss_scale_px;
        let per_track: Vec<f64> = self
            .tracks
            .par_iter()
            .zip(&u.points)
            .enumerate()
            .with_min_len(64)
            .map(|(t, (track, p))| {
                let loss = |m: &Observation| {
                    let seen = self.project(m.view, &u.corrections[m.view], *p);
                    let (d_col, d_row) = (m.px.col - seen.col, m.px.row - seen.row);
                    m.weight * ((d_col * d_col + d_row * d_row) / scale2).ln_1p()
                };
                let observed =
                    scale2 / (SIGMA_PX * SIGMA_PX) * track.observations.iter().map(loss).sum::<f64>();
                let height = self.heights.as_ref().map_or(0.0, |h| h.cost(t, *p));
                0.5 * (observed + track.prior.map_or(0.0, |k| k.square(*p))) + height
            })
            .collect();
        let priors: f64 = (0..u.corrections.len()).map(|v| self.prior_cost(v, &u.corrections[v])).sum();
        per_track.iter().sum::<f64>() + priors
    }

    /// Quadratic near zero; a shift's then linear, so that one view's large shift pulls no harder than any other's.
    fn prior_cost(&self, view: usize, p: &Parameters) -> f64 {
        let sigma2 = self.prior_sigma_px().powi(2);
        let edges: f64 = p[2..].iter().map(|e| (e / self.edge_sigma_px(view)).powi(2)).sum();
        (1.0 + (p[0] * p[0] + p[1] * p[1]) / sigma2).sqrt() - 1.0 + 0.5 * edges
    }

    /// Weights of the parameters' priors.
    #[must_use]
    pub fn prior_weights(&self, view: usize, p: &Parameters) -> Parameters {
        let sigma2 = self.prior_sigma_px().powi(2);
        let shift = 1.0 / (1.0 + (p[0] * p[0] + p[1] * p[1]) / sigma2).sqrt() / sigma2;
        let edge = self.edge_sigma_px(view).powi(-2);
        let mut weights = [edge; MOST];
        weights[..2].fill(shift);
        weights
    }

    fn prior_sigma_px(&self) -> f64 {
        let controlled = self.tracks.iter().any(|t| t.prior.is_some());
        if controlled { PRIOR_SIGMA_WITH_CONTROL_PX } else { PRIOR_SIGMA_PX }
    }

    fn edge_sigma_px(&self, view: usize) -> f64 {
        EDGE_SIGMA_PX * (self.frames[view].side_px() / EDGE_SIDE_PX).max(1.0)
    }
}

impl PositionPrior {
    /// Squared distance in standard deviations.
    fn square(&self, p: [f64; 3]) -> f64 {
        (0..3).map(|k| ((p[k] - self.place[k]) / self.sigma_m[k]).powi(2)).sum()
    }
}
