//! The adjustment as a least-squares problem: unknowns, observations, residuals and derivatives.
//!
//! The unknowns are the correction of each view and the position of each point, in metres east, north and up of the
//! scene's centre. These coordinates are scaled geodetic ones, so that the chain rule is a diagonal matrix. Priors on
//! the corrections define the datum. Beyond one standard deviation the prior of a shift is linear, so that a single
//! wrong view cannot move the datum.

use super::correction::{CorrectionModel, ImageFrame, MOST, Parameters};
use super::point_heights::PointHeights;
use crate::frame::{CenterPx, Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use rayon::prelude::*;

/// Standard deviation of the image position of a keypoint, pixels.
pub const SIGMA_PX: f64 = 0.3;
/// Standard deviation of the prior of a view's shift, pixels.
///
/// It is tighter than the pointing accuracy of vendors: along the three directions of the datum that observations leave
/// free, the small systematic errors of thousands of observations would otherwise outweigh the priors and translate the
/// scene. In all other directions the effect of the priors is below 0.001 px.
const PRIOR_SIGMA_PX: f64 = 1.0;
/// The same where ground control defines the datum: the pointing accuracy of vendors.
const PRIOR_SIGMA_WITH_CONTROL_PX: f64 = 10.0;
/// Standard deviation of the prior of the other parameters, pixels at the image's edge, for images up to the side
/// below; for larger ones it grows in proportion.
///
/// Nearly affine cameras with free scales would leave the heights free to tilt and to scale.
const EDGE_SIGMA_PX: f64 = 0.05;
const EDGE_SIDE_PX: f64 = 4096.0;

/// An observation: the image position of a point in a view.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the view.
    pub view: usize,
    /// Observed position.
    pub px: Pixel<CenterPx>,
    /// Weight relative to an observation with the standard deviation [`SIGMA_PX`].
    pub weight: f64,
}

/// Prior knowledge of a point's position, as a survey gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionPrior {
    /// Metres east, north and up of the block's centre.
    pub place: [f64; 3],
    /// Standard deviations east, north and up, metres.
    pub sigma_m: [f64; 3],
}

/// A point on the ground with its observations.
#[derive(Clone, Debug, Default)]
pub struct Track {
    /// Observations, at most one per view.
    pub observations: Vec<Observation>,
    /// Gray value of the point, 0 to 255.
    pub gray: u8,
    /// Surveyed position, for ground control.
    pub prior: Option<PositionPrior>,
    /// Index of the cell of ground that it is from; 0 in a scene of one cell.
    pub cell: u32,
}

/// The unknowns: corrections and points.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknowns {
    /// Correction of each view.
    pub corrections: Vec<Parameters>,
    /// Position of each track's point: metres east, north and up of the centre.
    pub points: Vec<[f64; 3]>,
}

/// A block of views with all observations, weights and priors.
pub struct Block<'a> {
    /// The delivered RPC of each view.
    pub rpcs: Vec<&'a Rpc>,
    /// Image frame of each view.
    pub frames: Vec<ImageFrame>,
    /// The points with their observations.
    pub tracks: Vec<Track>,
    /// Scale of the Cauchy loss, pixels.
    pub loss_scale_px: f64,
    /// Which parameters of a correction are unknowns.
    pub model: CorrectionModel,
    /// Whether the correction of a view is held fixed.
    pub is_fixed: Vec<bool>,
    /// Height priors of the points from an elevation model.
    pub heights: Option<PointHeights>,
    center: Point<Geodetic>,
    /// Degrees of longitude, degrees of latitude and metres of height per metre.
    per_metre: [f64; 3],
}

/// A linearised observation: its residual (observed minus predicted, pixels), the derivative of the prediction by the
/// point (pixels per metre), the normalised image position, and the weight by the robust loss.
#[derive(Clone, Copy, Debug)]
pub struct Linearised {
    pub residual: [f64; 2],
    pub by_point: [[f64; 3]; 2],
    pub at: [f64; 2],
    pub weight: f64,
}

impl<'a> Block<'a> {
    /// A block without tracks, whose coordinates count from `center`.
    #[must_use]
    pub fn new(rpcs: Vec<&'a Rpc>, frames: Vec<ImageFrame>, center: Point<Geodetic>) -> Self {
        // Semi-major axis and squared eccentricity of WGS 84, for the radii of curvature.
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
            model: CorrectionModel::Shift,
            is_fixed,
            heights: None,
            center,
            per_metre,
        }
    }

    /// Geodetic coordinates of a point in metres from the centre.
    #[must_use]
    pub fn geodetic(&self, p: [f64; 3]) -> Point<Geodetic> {
        let c = self.center.xyz();
        let [x, y, z] = std::array::from_fn(|k| c[k] + p[k] * self.per_metre[k]);
        Point::new(x, y, z)
    }

    /// Metres from the centre to a geodetic point.
    #[must_use]
    pub fn local(&self, p: Point<Geodetic>) -> [f64; 3] {
        let (c, p) = (self.center.xyz(), p.xyz());
        std::array::from_fn(|k| (p[k] - c[k]) / self.per_metre[k])
    }

    /// Image position of a point in a view.
    #[must_use]
    pub fn project(&self, view: usize, correction: &Parameters, point: [f64; 3]) -> Pixel<CenterPx> {
        self.frames[view].corrected_px(correction, self.rpcs[view].project(self.geodetic(point)))
    }

    /// Linearises one observation.
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

    /// Distance between the predicted and the observed position, pixels.
    #[must_use]
    pub fn distance(&self, m: &Observation, correction: &Parameters, point: [f64; 3]) -> f64 {
        self.project(m.view, correction, point).distance(m.px)
    }

    /// The robust cost: half the Cauchy loss of all observations plus the cost of the priors.
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

    /// Cost of a view's prior: quadratic near zero; that of the shift becomes linear, so that the force of a large
    /// shift on the datum is no stronger than that of any other.
    fn prior_cost(&self, view: usize, p: &Parameters) -> f64 {
        let sigma2 = self.prior_sigma_px().powi(2);
        let edges: f64 = p[2..].iter().map(|e| (e / self.edge_sigma_px(view)).powi(2)).sum();
        (1.0 + (p[0] * p[0] + p[1] * p[1]) / sigma2).sqrt() - 1.0 + 0.5 * edges
    }

    /// Weights of the priors of a view's parameters, at their present values.
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
    /// Squared distance of a position from the surveyed one, in standard deviations.
    fn square(&self, p: [f64; 3]) -> f64 {
        (0..3).map(|k| ((p[k] - self.place[k]) / self.sigma_m[k]).powi(2)).sum()
    }
}
