//! The stages in a row: features, pairs, matches, tracks, the solve with rejection, all but the features twice;
//! then patches in the place of keypoints, and the last solve.

use super::error::BundleError;
use super::features::{Keypoint, detect};
use super::matching::{Match, MatchView, matches};
use super::output::{Adjustment, SparsePoint};
use super::patches::{self, Seeker};
use super::problem::{Block, Measurement, Unknowns};
use super::report::Report;
use super::solver::SchurLevenbergMarquardt;
use super::tracks::{self, Observation};
use crate::event::{Event, Sink};
use crate::frame::{Geodetic, Point, SiteGrid};
use crate::raster::{Plane, RasterError};
use crate::rpc::Rpc;
use crate::scene::{Scene, angle_between_deg, footprint};
use argmin::core::{Executor, State};
use geo::{Area, BooleanOps};
use rayon::prelude::*;

/// Distance across the epipolar segments that is searched first, pixels: a delivered RPC may be tens of pixels off.
const WIDE_PX: f64 = 60.0;
/// The same with corrected cameras.
const NARROW_PX: f64 = 4.0;
/// Share of the smaller footprint that two views must share to be matched.
const LEAST_OVERLAP: f64 = 0.2;
/// Angles between views that are matched, and from which heights can be measured, degrees.
const WIDEST_DEG: f64 = 60.0;
const LEAST_ANGLE_DEG: f64 = 3.0;
/// Views with fewer keypoints are left out.
const FEWEST_KEYPOINTS: usize = 50;
/// Margin around the heights of the first round's points for the second, metres.
const HEIGHT_MARGIN_M: f64 = 15.0;
/// Scales of the robust loss, round by round, pixels.
const LOSS_SCALES_PX: [f64; 3] = [8.0, 1.0, 0.3];
/// Rejections after the last scale, and what they allow at least: pixels, robust standard deviations.
const REJECTIONS: usize = 3;
const REJECT_PX: f64 = 0.6;
const REJECT_SIGMAS: f64 = 2.5;
/// Views that must show a patch, or half of all if these are fewer, and the weight of keypoints that no patch
/// confirms: they place a view that no patch reaches, and nothing else.
const FEWEST_VIEWS: usize = 4;
const UNCONFIRMED: f64 = 0.01;
const MAX_ITERATIONS: u64 = 50;
const VIEWS_AT_ONCE: usize = 4;

/// How to adjust.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Leave the cameras as they are: only tracks and points.
    pub fixed: bool,
    /// Lowest and highest ellipsoidal height to search, metres, if not what the scene tells.
    pub height_range: Option<(f64, f64)>,
}

/// Adjusts a scene's cameras.
///
/// Views without enough keypoints or without matches are left out, with a warning each.
///
/// # Errors
/// [`BundleError`]: too few views, no common ground, matches that do not connect the views.
pub fn adjust(scene: &Scene, options: &Options, events: Sink) -> Result<Adjustment, BundleError> {
    scene.require_views(2)?;
    scene.require_shared_ground()?;
    let heights = options.height_range.unwrap_or_else(|| scene.height_range());
    // A comparison that NaN fails too.
    if !matches!(heights.0.partial_cmp(&heights.1), Some(std::cmp::Ordering::Less)) {
        return Err(BundleError::Heights { low_m: heights.0, high_m: heights.1 });
    }
    let mut work = Work::new(scene, heights, events)?;
    let mut state = Progress::start(work.views.len());
    if options.fixed {
        work.round(&mut state, NARROW_PX, heights, false)?;
    } else {
        work.round(&mut state, WIDE_PX, heights, true)?;
        let narrowed = work.narrowed_heights(&state, heights);
        work.round(&mut state, NARROW_PX, narrowed, true)?;
        work.settle(&mut state, narrowed)?;
    }
    let mut adjustment = work.result(&state, options.fixed);
    for (name, rpc) in &mut adjustment.cameras {
        if let Some(view) = scene.views.iter().find(|v| v.name == *name) {
            *rpc = view.camera_of_whole(rpc);
        }
    }
    Ok(adjustment)
}

/// A usable view.
struct WorkView<'a> {
    name: &'a str,
    rpc: &'a Rpc,
    size: (usize, usize),
    keypoints: Vec<Keypoint>,
    /// Blurred a little, for patches.
    image: Plane,
    /// Azimuth and off-nadir, degrees.
    direction: (f64, f64),
}

struct Work<'a> {
    views: Vec<WorkView<'a>>,
    pairs: Vec<(usize, usize)>,
    left_out: Vec<(String, String)>,
    center: Point<Geodetic>,
    events: Sink<'a>,
}

/// Where the adjustment stands.
struct Progress {
    shifts: Vec<[f64; 2]>,
    tracks: Vec<Vec<Measurement>>,
    points: Vec<[f64; 3]>,
}

impl Progress {
    fn start(views: usize) -> Self {
        Self { shifts: vec![[0.0; 2]; views], tracks: Vec::new(), points: Vec::new() }
    }
}

impl<'a> Work<'a> {
    fn new(scene: &'a Scene, heights: (f64, f64), events: Sink<'a>) -> Result<Self, BundleError> {
        let middle = 0.5 * (heights.0 + heights.1);
        let center = scene.center().unwrap_or_else(|| scene.views[0].rpc.center()).at_height(middle);
        events(Event::Started { stage: "finding features", total: scene.views.len() as u64 });
        let mut views = Vec::new();
        let mut left_out = Vec::new();
        let mut detected = Vec::with_capacity(scene.views.len());
        // A few views at a time: the scale space of one takes thirty times its pixels.
        for some in scene.views.chunks(rayon::current_num_threads().min(VIEWS_AT_ONCE)) {
            let found: Vec<Result<_, RasterError>> = some
                .par_iter()
                .map(|v| {
                    let image = v.read_gray()?;
                    Ok((detect(&image), patches::prepared(&image)))
                })
                .collect();
            detected.extend(found);
            events(Event::Advanced { done: detected.len() as u64, status: String::new() });
        }
        for (view, keypoints) in scene.views.iter().zip(detected) {
            let (keypoints, image): (Vec<Keypoint>, Plane) = keypoints?;
            let found = keypoints.len();
            match view.direction_deg(middle) {
                _ if found < FEWEST_KEYPOINTS => {
                    left_out.push((
                        view.name.clone(),
                        format!("{found} keypoints: is the image constant or empty?"),
                    ));
                }
                None => {
                    left_out.push((view.name.clone(), "its RPC sees no ground at the scene's heights".into()))
                }
                Some(direction) => views.push(WorkView {
                    name: &view.name,
                    rpc: &view.rpc,
                    size: (view.width, view.height),
                    keypoints,
                    image,
                    direction,
                }),
            }
        }
        events(Event::Finished);
        for (name, reason) in &left_out {
            events(Event::Warning(format!("view `{name}` is left out: {reason}")));
        }
        if views.len() < 2 {
            return Err(too_few(views.len(), scene.views.len(), &left_out));
        }
        let pairs = pairs(&views, center)?;
        Ok(Self { views, pairs, left_out, center, events })
    }

    /// Matches within `across` pixels, makes tracks, solves and rejects.
    fn round(
        &mut self,
        state: &mut Progress,
        across: f64,
        heights: (f64, f64),
        free: bool,
    ) -> Result<(), BundleError> {
        let cameras = self.corrected(&state.shifts);
        let found = self.match_pairs(&cameras, across, heights);
        let counts: Vec<usize> = self.views.iter().map(|v| v.keypoints.len()).collect();
        let tracks = tracks::build(&counts, &found);
        self.require_connection(&tracks)?;

        let block = self.block(&tracks, &state.shifts);
        state.tracks = block.0;
        state.points = block.1;
        (self.events)(Event::Started { stage: "adjusting", total: 0 });
        let scales: &[f64] = if across > NARROW_PX { &LOSS_SCALES_PX } else { &LOSS_SCALES_PX[1..] };
        self.refine(state, scales, heights, free)?;
        (self.events)(Event::Finished);
        if state.tracks.is_empty() {
            return Err(BundleError::NotConnected { components: "no track survived the adjustment".into() });
        }
        Ok(())
    }

    /// Solves and rejects, with a tighter and tighter loss, until nothing is rejected any more.
    fn refine(
        &self,
        state: &mut Progress,
        scales: &[f64],
        heights: (f64, f64),
        free: bool,
    ) -> Result<(), BundleError> {
        for scale in scales {
            self.solve(state, *scale, free)?;
            self.reject(state, heights, (4.0 * scale).max(REJECT_PX));
        }
        for _ in 0..REJECTIONS {
            self.solve(state, LOSS_SCALES_PX[2], free)?;
            if self.reject(state, heights, REJECT_PX) == 0 {
                break;
            }
        }
        Ok(())
    }

    /// Measures the tracks anew by patches in all views, and solves with these; keypoints count little from now on.
    fn settle(&self, state: &mut Progress, heights: (f64, f64)) -> Result<(), BundleError> {
        (self.events)(Event::Started { stage: "measuring patches", total: 0 });
        let block = Block::new(self.rpcs(), Vec::new(), self.center);
        let images = self.views.iter().map(|v| &v.image).collect();
        let seeker = Seeker::new(&block, &state.shifts, images);
        let fewest = FEWEST_VIEWS.min(self.views.len().div_ceil(2));
        state.tracks = state
            .tracks
            .par_iter()
            .zip(&state.points)
            .with_min_len(16)
            .map(|(track, point)| {
                let found = seeker.track(&track[0], *point);
                if found.len() >= fewest {
                    found
                } else {
                    track.iter().map(|m| Measurement { weight: UNCONFIRMED, ..*m }).collect()
                }
            })
            .collect();
        let confirmed = state.tracks.iter().filter(|t| t[0].weight > UNCONFIRMED).count();
        tracing::debug!("patches confirm {confirmed} of {} tracks", state.tracks.len());
        self.refine(state, &LOSS_SCALES_PX[1..], heights, true)?;
        (self.events)(Event::Finished);
        Ok(())
    }

    fn corrected(&self, shifts: &[[f64; 2]]) -> Vec<Rpc> {
        self.views.iter().zip(shifts).map(|(v, s)| v.rpc.shifted(s[0], s[1])).collect()
    }

    fn match_pairs(
        &self,
        cameras: &[Rpc],
        across: f64,
        heights: (f64, f64),
    ) -> Vec<((usize, usize), Vec<Match>)> {
        let prepared: Vec<MatchView> = self
            .views
            .iter()
            .zip(cameras)
            .map(|(v, rpc)| MatchView::new(rpc, &v.keypoints, v.size, heights))
            .collect();
        (self.events)(Event::Started { stage: "matching", total: self.pairs.len() as u64 });
        let mut found = Vec::with_capacity(self.pairs.len());
        for (done, &(i, j)) in self.pairs.iter().enumerate() {
            found.push(((i, j), matches(&prepared[i], &prepared[j], across)));
            (self.events)(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        (self.events)(Event::Finished);
        for ((i, j), m) in &found {
            tracing::debug!("{} - {}: {} matches", self.views[*i].name, self.views[*j].name, m.len());
        }
        found
    }

    fn require_connection(&self, found: &[Vec<Observation>]) -> Result<(), BundleError> {
        let groups = tracks::components(self.views.len(), found);
        if groups.len() <= 1 {
            return Ok(());
        }
        let list = |g: &Vec<usize>| {
            let names: Vec<&str> = g.iter().map(|v| self.views[*v].name).collect();
            format!("{{{}}}", names.join(", "))
        };
        let components = groups.iter().map(list).collect::<Vec<_>>().join(" | ");
        Err(BundleError::NotConnected { components })
    }

    /// Measurements and first places of the tracks that some pair of views sees at a useful angle.
    fn block(
        &self,
        found: &[Vec<Observation>],
        shifts: &[[f64; 2]],
    ) -> (Vec<Vec<Measurement>>, Vec<[f64; 3]>) {
        let measured: Vec<Vec<Measurement>> = found
            .iter()
            .map(|track| {
                let measure = |o: &Observation| Measurement {
                    view: o.view as usize,
                    px: self.views[o.view as usize].keypoints[o.keypoint as usize].px,
                    weight: 1.0,
                };
                track.iter().map(measure).collect()
            })
            .filter(|track: &Vec<Measurement>| self.angle_deg(track) >= LEAST_ANGLE_DEG)
            .collect();
        let block = Block::new(self.rpcs(), Vec::new(), self.center);
        let places: Vec<Option<[f64; 3]>> =
            measured.par_iter().with_min_len(64).map(|t| triangulate(&block, t, shifts)).collect();
        let pairs = measured.into_iter().zip(places);
        pairs.filter_map(|(t, p)| Some((t, p?))).unzip()
    }

    fn rpcs(&self) -> Vec<&'a Rpc> {
        self.views.iter().map(|v| v.rpc).collect()
    }

    /// Widest angle between two of a track's views.
    fn angle_deg(&self, track: &[Measurement]) -> f64 {
        let mut widest: f64 = 0.0;
        for (k, a) in track.iter().enumerate() {
            for b in &track[k + 1..] {
                widest =
                    widest.max(angle_between_deg(self.views[a.view].direction, self.views[b.view].direction));
            }
        }
        widest
    }

    fn solve(&self, state: &mut Progress, loss_scale_px: f64, free: bool) -> Result<(), BundleError> {
        let mut block = Block::new(self.rpcs(), std::mem::take(&mut state.tracks), self.center);
        block.loss_scale_px = loss_scale_px;
        block.shifts_free = free;
        let start = Unknowns { shifts: state.shifts.clone(), points: std::mem::take(&mut state.points) };
        let failed = |reason: String| BundleError::Solver { reason };
        let run = Executor::new(block, SchurLevenbergMarquardt::default())
            .configure(|s| s.param(start).max_iters(MAX_ITERATIONS))
            .run()
            .map_err(|e| failed(e.to_string()))?;
        let mut search = run.state;
        tracing::debug!("{} iterations, cost {:.6e}", search.get_iter(), search.get_cost());
        let end = search.take_param().or_else(|| search.take_best_param());
        let end = end.ok_or_else(|| failed("no solution".into()))?;
        let block = run.problem.get_problem().ok_or_else(|| failed("no problem".into()))?;
        state.tracks = block.tracks;
        (state.shifts, state.points) = (end.shifts, end.points);
        Ok(())
    }

    /// Drops observations further off than `least` pixels and the robust limit, and what is left without support.
    fn reject(&self, state: &mut Progress, heights: (f64, f64), least: f64) -> usize {
        let block = Block::new(self.rpcs(), Vec::new(), self.center);
        let distance = |m: &Measurement, p: [f64; 3]| block.distance(m, state.shifts[m.view], p);
        let mut all: Vec<f64> = state
            .tracks
            .iter()
            .zip(&state.points)
            .flat_map(|(t, p)| t.iter().map(|m| distance(m, *p)))
            .collect();
        if all.is_empty() {
            return 0;
        }
        let middle = all.len() / 2;
        let median = *all.select_nth_unstable_by(middle, f64::total_cmp).1;
        let limit = least.max(REJECT_SIGMAS * 1.4826 * median);
        let slack = HEIGHT_MARGIN_M;
        let before: usize = state.tracks.iter().map(Vec::len).sum();
        let count = state.tracks.len();
        let (tracks, points): (Vec<_>, Vec<_>) = std::mem::take(&mut state.tracks)
            .into_iter()
            .zip(std::mem::take(&mut state.points))
            .filter_map(|(mut track, mut point)| {
                let n = track.len();
                track.retain(|m| distance(m, point) <= limit);
                if track.len() < 2 || self.angle_deg(&track) < LEAST_ANGLE_DEG {
                    return None;
                }
                if track.len() < n {
                    point = triangulate(&block, &track, &state.shifts)?;
                }
                let h = block.geodetic(point).height_m();
                (h >= heights.0 - slack && h <= heights.1 + slack).then_some((track, point))
            })
            .unzip();
        tracing::debug!("median {median:.2} px, limit {limit:.2} px: {count} tracks become {}", tracks.len());
        (state.tracks, state.points) = (tracks, points);
        before - state.tracks.iter().map(Vec::len).sum::<usize>()
    }

    /// The heights of nearly all points, and a margin.
    fn narrowed_heights(&self, state: &Progress, heights: (f64, f64)) -> (f64, f64) {
        let mut z: Vec<f64> = state.points.iter().map(|p| p[2] + self.center.height_m()).collect();
        z.sort_by(f64::total_cmp);
        let at = |share: f64| z[(share * (z.len() - 1) as f64) as usize];
        (
            (at(0.005) - HEIGHT_MARGIN_M).max(heights.0 - HEIGHT_MARGIN_M),
            (at(0.995) + HEIGHT_MARGIN_M).min(heights.1 + HEIGHT_MARGIN_M),
        )
    }

    fn result(&self, state: &Progress, fixed: bool) -> Adjustment {
        let block = Block::new(self.rpcs(), Vec::new(), self.center);
        let none = vec![[0.0; 2]; self.views.len()];
        // The same observations with the cameras as delivered, points placed as well as these allow.
        let before: Vec<Vec<(usize, f64)>> = state
            .tracks
            .par_iter()
            .with_min_len(64)
            .map(|t| {
                let Some(p) = triangulate(&block, t, &none) else { return Vec::new() };
                t.iter().map(|m| (m.view, block.distance(m, none[m.view], p))).collect()
            })
            .collect();
        let after: Vec<(usize, f64)> = state
            .tracks
            .iter()
            .zip(&state.points)
            .flat_map(|(t, p)| t.iter().map(|m| (m.view, block.distance(m, state.shifts[m.view], *p))))
            .collect();
        let names: Vec<String> = self.views.iter().map(|v| v.name.to_owned()).collect();
        let gauge = if fixed {
            "cameras as given"
        } else {
            "mean of the delivered cameras: robust priors on the shifts"
        };
        let report = Report::new(
            gauge,
            &names,
            &state.shifts,
            state.tracks.len(),
            &before.concat(),
            &after,
            self.left_out.clone(),
        );
        let points = state
            .tracks
            .iter()
            .zip(&state.points)
            .map(|(t, p)| SparsePoint { position: block.geodetic(*p), views: t.len() as u8 })
            .collect();
        Adjustment { cameras: names.into_iter().zip(self.corrected(&state.shifts)).collect(), points, report }
    }
}

fn too_few(usable: usize, all: usize, left_out: &[(String, String)]) -> BundleError {
    let list: Vec<String> = left_out.iter().map(|(n, r)| format!("{n} ({r})")).collect();
    BundleError::TooFewViews { usable, all, left_out: list.join(", ") }
}

/// Pairs of views that share ground and whose directions differ enough, but not too much.
fn pairs(views: &[WorkView], center: Point<Geodetic>) -> Result<Vec<(usize, usize)>, BundleError> {
    let grid = SiteGrid::at(center).map_err(crate::scene::SceneError::from)?;
    let outlines: Vec<_> = views.iter().map(|v| footprint(v.rpc, v.size, &grid, center.height_m())).collect();
    let mut out = Vec::new();
    let mut widest: f64 = 0.0;
    for i in 0..views.len() {
        for j in i + 1..views.len() {
            let (Some(a), Some(b)) = (&outlines[i], &outlines[j]) else { continue };
            let shared = a.intersection(b).unsigned_area() / a.unsigned_area().min(b.unsigned_area());
            let angle = angle_between_deg(views[i].direction, views[j].direction);
            if shared >= LEAST_OVERLAP && angle <= WIDEST_DEG {
                widest = widest.max(angle);
                out.push((i, j));
            }
        }
    }
    if widest < LEAST_ANGLE_DEG {
        return Err(BundleError::NoBaseline { needed_deg: LEAST_ANGLE_DEG });
    }
    Ok(out)
}

/// The point nearest to a track's rays, by Gauss and Newton; none if its rays do not fix one.
fn triangulate(block: &Block, track: &[Measurement], shifts: &[[f64; 2]]) -> Option<[f64; 3]> {
    let first = track.first()?;
    let shift = shifts[first.view];
    let px = crate::frame::Pixel::new(first.px.col - shift[0], first.px.row - shift[1]);
    let start = block.rpcs[first.view].localize(px, block.geodetic([0.0; 3]).height_m()).ok()?;
    let mut point = block.local(start);
    for _ in 0..10 {
        let mut normal = nalgebra::Matrix3::<f64>::zeros();
        let mut right = nalgebra::Vector3::<f64>::zeros();
        for m in track {
            let o = block.linearise(m, shifts[m.view], point);
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
#[path = "adjust_tests.rs"]
mod tests;
