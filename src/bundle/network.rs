//! The solution for cameras and tracks in stages, with decreasing scales of the robust loss and rejection of outliers.

use super::correction::{CorrectionModel, ImageFrame, MOST, Parameters};
use super::error::BundleError;
use super::height_prior::HeightPrior;
use super::precision::Precision;
use super::problem::{Block, Observation, Track, Unknowns};
use super::solver::{Log, SchurLevenbergMarquardt};
use crate::frame::{Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use crate::scene::angle_between_deg;
use crate::stats::MAD_TO_SIGMA;
use argmin::core::Executor;
use argmin::core::observers::ObserverMode;
use rayon::prelude::*;

/// Smallest angle between two views of a track, degrees; the heights of tracks below it are too inaccurate.
pub const LEAST_ANGLE_DEG: f64 = 3.0;
/// Points may lie this far outside of the range of heights, metres.
pub const HEIGHT_MARGIN_M: f64 = 15.0;
/// Scales of the robust loss, one after the other, pixels.
pub const LOSS_SCALES_PX: [f64; 3] = [8.0, 1.0, 0.3];
/// Number of rejections after the last scale, and their limit in robust standard deviations.
const REJECTIONS: usize = 3;
const REJECT_SIGMAS: f64 = 2.0;
const MAX_ITERATIONS: u64 = 50;

/// The views of an adjustment with their delivered cameras.
pub struct Network<'a> {
    /// The delivered RPC of each view.
    pub rpcs: Vec<&'a Rpc>,
    /// Image frame of each view.
    pub frames: Vec<ImageFrame>,
    /// Whether a view is a reference view, whose camera is not corrected.
    pub is_fixed: Vec<bool>,
    /// Direction of each view from the ground: azimuth and off-nadir angle, degrees.
    pub directions: Vec<(f64, f64)>,
    /// Origin of the points' coordinates.
    pub center: Point<Geodetic>,
    /// Lowest and highest ellipsoidal height of points, metres.
    pub heights: (f64, f64),
    /// Elevation model that serves as a prior of the heights.
    pub height_prior: Option<&'a HeightPrior>,
}

/// The present estimate of all unknowns.
pub struct Estimate {
    /// Correction of each view.
    pub corrections: Vec<Parameters>,
    /// The tracks, with the observations that are not rejected.
    pub tracks: Vec<Track>,
    /// Position of each track's point: metres east, north and up of the network's centre.
    pub points: Vec<[f64; 3]>,
}

impl Estimate {
    /// The start of an adjustment: no corrections, no tracks.
    #[must_use]
    pub fn start(views: usize) -> Self {
        Self { corrections: vec![[0.0; MOST]; views], tracks: Vec::new(), points: Vec::new() }
    }
}

impl<'a> Network<'a> {
    /// The least-squares problem of the network, without tracks.
    #[must_use]
    pub fn block(&self) -> Block<'a> {
        let mut block = Block::new(self.rpcs.clone(), self.frames.clone(), self.center);
        block.is_fixed.clone_from(&self.is_fixed);
        block
    }

    /// Triangulates tracks and makes them those of the estimate; tracks without a pair of views at a sufficient angle
    /// are dropped. Points of ground control start at their surveyed positions.
    pub fn triangulate_tracks(&self, estimate: &mut Estimate, tracks: Vec<Track>) {
        let block = self.block();
        let places: Vec<Option<[f64; 3]>> = tracks
            .par_iter()
            .with_min_len(64)
            .map(|t| match t.prior {
                Some(known) => Some(known.place),
                None if self.angle_deg(t) < LEAST_ANGLE_DEG => None,
                None => triangulate(&block, t, &estimate.corrections),
            })
            .collect();
        let placed = tracks.into_iter().zip(places).filter_map(|(t, p)| Some((t, p?)));
        (estimate.tracks, estimate.points) = placed.unzip();
    }

    /// Largest angle between two of a track's views, degrees.
    #[must_use]
    pub fn angle_deg(&self, track: &Track) -> f64 {
        let mut widest: f64 = 0.0;
        for (k, a) in track.observations.iter().enumerate() {
            for b in &track.observations[k + 1..] {
                widest = widest.max(angle_between_deg(self.directions[a.view], self.directions[b.view]));
            }
        }
        widest
    }

    /// Solves and rejects outliers with decreasing scales of the loss, until no observation is rejected any more.
    /// Observations with residuals below `allowed_px` are never rejected.
    ///
    /// # Errors
    /// [`BundleError::Solver`].
    pub fn refine(
        &self,
        estimate: &mut Estimate,
        scales: &[f64],
        model: CorrectionModel,
        allowed_px: f64,
    ) -> Result<(), BundleError> {
        for scale in scales {
            self.solve(estimate, *scale, model)?;
            self.reject(estimate, (4.0 * scale).max(allowed_px));
        }
        for _ in 0..REJECTIONS {
            self.solve(estimate, LOSS_SCALES_PX[2], model)?;
            if self.reject(estimate, allowed_px) == 0 {
                break;
            }
        }
        Ok(())
    }

    fn solve(
        &self,
        estimate: &mut Estimate,
        loss_scale_px: f64,
        model: CorrectionModel,
    ) -> Result<(), BundleError> {
        let mut block = self.block();
        block.tracks = std::mem::take(&mut estimate.tracks);
        block.loss_scale_px = loss_scale_px;
        block.model = model;
        let points = std::mem::take(&mut estimate.points);
        block.heights = self.height_prior.map(|prior| prior.at(&block, &points));
        let start = Unknowns { corrections: estimate.corrections.clone(), points };
        let failed = |reason: String| BundleError::Solver { reason };
        let run = Executor::new(block, SchurLevenbergMarquardt::default())
            .configure(|s| s.param(start).max_iters(MAX_ITERATIONS))
            .add_observer(Log, ObserverMode::Always)
            .run()
            .map_err(|e| failed(e.to_string()))?;
        let mut search = run.state;
        let end = search.take_param().or_else(|| search.take_best_param());
        let end = end.ok_or_else(|| failed("no solution".into()))?;
        let block = run.problem.get_problem().ok_or_else(|| failed("no problem".into()))?;
        estimate.tracks = block.tracks;
        (estimate.corrections, estimate.points) = (end.corrections, end.points);
        Ok(())
    }

    /// Precision of an estimate; with `fixed`, that of the points for exact cameras.
    #[must_use]
    pub fn precision(&self, estimate: &Estimate, model: CorrectionModel, fixed: bool) -> Option<Precision> {
        let mut block = self.block();
        block.is_fixed.iter_mut().for_each(|h| *h |= fixed);
        block.tracks = estimate.tracks.clone();
        // Outliers are rejected before, so that no robust loss is needed.
        block.loss_scale_px = f64::INFINITY;
        block.model = model;
        let at = Unknowns { corrections: estimate.corrections.clone(), points: estimate.points.clone() };
        Precision::of(&block, &at)
    }

    /// Rejects observations with residuals above `least` pixels and above the robust limit, and tracks that are left
    /// with too few views, too small an angle or a height out of range. Ground control is kept. Returns the number of
    /// rejected observations.
    fn reject(&self, estimate: &mut Estimate, least: f64) -> usize {
        let block = self.block();
        let corrections = &estimate.corrections;
        let distance = |m: &Observation, p: [f64; 3]| block.distance(m, &corrections[m.view], p);
        let mut all: Vec<f64> = estimate
            .tracks
            .par_iter()
            .zip(&estimate.points)
            .flat_map_iter(|(t, p)| t.observations.iter().map(|m| distance(m, *p)))
            .collect();
        if all.is_empty() {
            return 0;
        }
        let before = all.len();
        let median = *all.select_nth_unstable_by(before / 2, f64::total_cmp).1;
        let limit = least.max(REJECT_SIGMAS * MAD_TO_SIGMA * median);
        let (low, high) = (self.heights.0 - HEIGHT_MARGIN_M, self.heights.1 + HEIGHT_MARGIN_M);
        let count = estimate.tracks.len();
        let (tracks, points): (Vec<Track>, Vec<_>) = std::mem::take(&mut estimate.tracks)
            .into_iter()
            .zip(std::mem::take(&mut estimate.points))
            .filter_map(|(mut track, mut point)| {
                if track.prior.is_some() {
                    return Some((track, point));
                }
                let n = track.observations.len();
                track.observations.retain(|m| distance(m, point) <= limit);
                if track.observations.len() < 2 || self.angle_deg(&track) < LEAST_ANGLE_DEG {
                    return None;
                }
                if track.observations.len() < n {
                    point = triangulate(&block, &track, corrections)?;
                }
                let h = block.geodetic(point).height_m();
                (low..=high).contains(&h).then_some((track, point))
            })
            .unzip();
        tracing::debug!("median {median:.2} px, limit {limit:.2} px: {count} tracks become {}", tracks.len());
        (estimate.tracks, estimate.points) = (tracks, points);
        before - estimate.tracks.iter().map(|t| t.observations.len()).sum::<usize>()
    }

    /// (view, residual in pixels) of every observation, track by track, without those of ground control.
    #[must_use]
    pub fn distances(&self, estimate: &Estimate) -> Vec<(usize, f64)> {
        let block = self.block();
        let of_track = |(t, p): (&Track, &[f64; 3])| -> Vec<(usize, f64)> {
            let distance = |m: &Observation| block.distance(m, &estimate.corrections[m.view], *p);
            t.observations.iter().map(|m| (m.view, distance(m))).collect()
        };
        let tied = estimate.tracks.par_iter().zip(&estimate.points).filter(|(t, _)| t.prior.is_none());
        tied.flat_map_iter(of_track).collect()
    }

    /// The delivered cameras, with the same tracks triangulated by them.
    #[must_use]
    pub fn as_delivered(&self, tracks: &[Track]) -> Estimate {
        let mut given = Estimate::start(self.rpcs.len());
        self.triangulate_tracks(&mut given, tracks.to_vec());
        given
    }
}

/// The point nearest to the rays of a track, by Gauss–Newton iterations; none if the rays do not determine one.
pub fn triangulate(block: &Block, track: &Track, corrections: &[Parameters]) -> Option<[f64; 3]> {
    let first = track.observations.first()?;
    let moved = block.frames[first.view].corrected_px(&corrections[first.view], first.px);
    // To first order, the delivered camera sees at this position what the corrected camera sees at `first.px`.
    let px = Pixel::new(2.0 * first.px.col - moved.col, 2.0 * first.px.row - moved.row);
    let start = block.rpcs[first.view].localize(px, block.geodetic([0.0; 3]).height_m()).ok()?;
    let mut point = block.local(start);
    for _ in 0..10 {
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        for m in &track.observations {
            let o = block.linearise(m, &corrections[m.view], point);
            for (row, r) in o.by_point.iter().zip(o.residual) {
                let j = nalgebra::Vector3::from(*row);
                normal += j * j.transpose();
                right += j * r;
            }
        }
        let step = normal.cholesky()?.solve(&right);
        for k in 0..3 {
            point[k] += step[k];
        }
        if step.norm() < 1e-6 {
            break;
        }
    }
    point.iter().all(|v| v.is_finite()).then_some(point)
}

#[cfg(test)]
#[path = "network_tests.rs"]
mod tests;
