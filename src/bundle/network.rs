//! Cameras and tracks: the solve in stages, with a tighter and tighter loss and rejection of what does not fit.

use super::correction::{ImageFrame, MOST, Model, Parameters};
use super::error::BundleError;
use super::height_prior::HeightPrior;
use super::precision::Precision;
use super::problem::{Block, Observation, Track, Unknowns};
use super::solver::{Log, SchurLevenbergMarquardt};
use crate::frame::{Geodetic, Pixel, Point};
use crate::rpc::Rpc;
use crate::scene::angle_between_deg;
use argmin::core::Executor;
use argmin::core::observers::ObserverMode;
use rayon::prelude::*;

/// Least angle between two views of a track, degrees: heights of others are not worth having.
pub const LEAST_ANGLE_DEG: f64 = 3.0;
/// How far outside the heights that were searched a point may lie, metres.
pub const HEIGHT_MARGIN_M: f64 = 15.0;
/// Scales of the robust loss, round by round, pixels.
pub const LOSS_SCALES_PX: [f64; 3] = [8.0, 1.0, 0.3];
/// Rejections after the last scale, and what they allow: robust standard deviations, and the caller's pixels at least.
const REJECTIONS: usize = 3;
const REJECT_SIGMAS: f64 = 2.0;
const MAX_ITERATIONS: u64 = 50;

/// The cameras as delivered.
pub struct Network<'a> {
    /// Their models.
    pub rpcs: Vec<&'a Rpc>,
    /// Their images.
    pub frames: Vec<ImageFrame>,
    /// Which of them are reference views, that stay as delivered.
    pub is_fixed: Vec<bool>,
    /// Where they look from: azimuth and off-nadir, degrees.
    pub directions: Vec<(f64, f64)>,
    /// The origin of points' coordinates.
    pub center: Point<Geodetic>,
    /// Lowest and highest height of points, metres.
    pub heights: (f64, f64),
    /// An elevation model that holds the height of the whole, if there is one.
    pub height_prior: Option<&'a HeightPrior>,
}

/// Where an adjustment stands.
pub struct Estimate {
    /// Of each view.
    pub corrections: Vec<Parameters>,
    /// The tracks.
    pub tracks: Vec<Track>,
    /// Where they are: metres east, north and up of the network's centre.
    pub points: Vec<[f64; 3]>,
}

impl Estimate {
    /// Cameras as delivered, and no tracks yet.
    #[must_use]
    pub fn start(views: usize) -> Self {
        Self { corrections: vec![[0.0; MOST]; views], tracks: Vec::new(), points: Vec::new() }
    }
}

impl<'a> Network<'a> {
    /// The network as a problem without tracks.
    #[must_use]
    pub fn block(&self) -> Block<'a> {
        let mut block = Block::new(self.rpcs.clone(), self.frames.clone(), self.center);
        block.is_fixed.clone_from(&self.is_fixed);
        block
    }

    /// Takes tracks that some pair of views sees at a useful angle, at the places nearest to their rays, and ground
    /// control where the survey says.
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

    /// Widest angle between two of a track's views.
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

    /// Solves and rejects, with a tighter and tighter loss, until nothing is rejected any more; what is within
    /// `allowed_px` is never rejected.
    ///
    /// # Errors
    /// [`BundleError::Solver`].
    pub fn refine(
        &self,
        estimate: &mut Estimate,
        scales: &[f64],
        model: Model,
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

    fn solve(&self, estimate: &mut Estimate, loss_scale_px: f64, model: Model) -> Result<(), BundleError> {
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

    /// How sure an estimate is of itself, with the cameras of all views taken as given if `fixed`.
    #[must_use]
    pub fn precision(&self, estimate: &Estimate, model: Model, fixed: bool) -> Option<Precision> {
        let mut block = self.block();
        block.is_fixed.iter_mut().for_each(|h| *h |= fixed);
        block.tracks = estimate.tracks.clone();
        // What a loss would weigh down is rejected by now.
        block.loss_scale_px = f64::INFINITY;
        block.model = model;
        let at = Unknowns { corrections: estimate.corrections.clone(), points: estimate.points.clone() };
        Precision::of(&block, &at)
    }

    /// Drops observations further off than `least` pixels and the robust limit, and what is left without support;
    /// ground control stays. The number of observations dropped.
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
        let limit = least.max(REJECT_SIGMAS * 1.4826 * median);
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

    /// (view, distance in pixels) of every observation, track by track; ground control is not among them.
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

    /// The cameras as delivered, and the same tracks placed as well as these allow.
    #[must_use]
    pub fn as_delivered(&self, tracks: &[Track]) -> Estimate {
        let mut given = Estimate::start(self.rpcs.len());
        self.triangulate_tracks(&mut given, tracks.to_vec());
        given
    }
}

/// The point nearest to a track's rays, by Gauss and Newton; none if its rays do not fix one.
pub fn triangulate(block: &Block, track: &Track, corrections: &[Parameters]) -> Option<[f64; 3]> {
    let first = track.observations.first()?;
    let moved = block.frames[first.view].corrected_px(&corrections[first.view], first.px);
    // To first order the given camera sees there what the corrected one sees at `first.px`.
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
