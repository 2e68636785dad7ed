//! The stages in a row: features, pairs, matches, tracks, the solve with rejection, all but the features twice;
//! then patches in the place of keypoints, and the last solve.

use super::control::{ControlPoint, tracks_of};
use super::control_check::control_report;
use super::correction::{ImageFrame, Model, Parameters};
use super::error::BundleError;
use super::features::Keypoint;
use super::height_prior::HeightPrior;
use super::keypoint_file::keypoints;
use super::matching::{Match, MatchView, matches};
use super::network::{Estimate, HEIGHT_MARGIN_M, LEAST_ANGLE_DEG, LOSS_SCALES_PX, Network};
use super::output::{Adjustment, PointQuality, SparsePoint, TiePoint};
use super::patches::{Part, Seeker, squares};
use super::problem::{Measurement, Track};
use super::report::{LeftOut, Report, ViewReport};
use super::tracks::{self, Observation};
use crate::frame::{Geodetic, Point, SiteGrid};
use crate::io::RasterError;
use crate::progress::{Event, Interrupted, Progress};
use crate::rpc::Rpc;
use crate::scene::{Scene, View, angle_between_deg, footprint};
use geo::{Area, BooleanOps};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Distance across the epipolar segments that is searched first, pixels: a delivered RPC may be tens of pixels off.
const WIDE_PX: f64 = 60.0;
/// Keypoints of a view that take part then: they cover it, and shifts need no more.
const WIDE_KEYPOINTS: usize = 2500;
/// The same with corrected cameras.
const NARROW_PX: f64 = 4.0;
/// Heights below and above the scene's for which corrected cameras are good where they must be refitted, metres.
const REFIT_MARGIN_M: f64 = 500.0;
/// Share of the smaller footprint that two views must share to be matched.
const LEAST_OVERLAP: f64 = 0.2;
/// Widest angle between views that are matched, degrees.
const WIDEST_DEG: f64 = 60.0;
/// Widest angle between the suns of views that are matched, degrees, but so many views with the nearest suns always are:
/// shadows of other shapes make wrong matches, and seasons go with the sun.
const SUNS_DEG: f64 = 20.0;
const NEAREST_SUNS: usize = 4;
/// Views with fewer keypoints are left out.
const FEWEST_KEYPOINTS: usize = 50;
/// So are views with fewer tie points, and those that keep less than this part of the share of their matches that the
/// middle one of all views keeps: sound views keep 0.87 of it or more on JAX_068 and simulated towns, an image turned by
/// 2 degrees 0.33.
const FEWEST_OBSERVATIONS: usize = 20;
const LEAST_KEPT: f64 = 0.5;
/// Views that must show a patch, or half of all if these are fewer, but two at least; and the weight of keypoints that
/// no patch confirms: they place a view that no patch reaches, and nothing else.
const FEWEST_VIEWS: usize = 4;
const UNCONFIRMED: f64 = 0.01;
/// Distances that are never rejected: of keypoints, which patches are to replace, and of patches, pixels.
const KEYPOINT_PX: f64 = 0.6;
const PATCH_PX: f64 = 0.4;
/// Standard deviation of a height, pixels on the ground, beyond which a point is not worth having.
const VAGUE_PX: f64 = 10.0;
/// Pixels of views that are searched side by side.
const PIXELS_AT_ONCE: usize = 8_000_000;
/// Side of the squares of ground whose patches are sought together, pixels.
const PIECE_PX: f64 = 2048.0;

/// How to adjust.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Leave the cameras as they are: tracks, the points nearest to their rays, and what it would take to correct.
    pub fixed: bool,
    /// What is corrected.
    pub model: Model,
    /// Lowest and highest ellipsoidal height to search, metres, if not what the scene tells.
    pub height_range: Option<(f64, f64)>,
    /// Surveyed points: with them the datum is theirs.
    pub control: Vec<ControlPoint>,
    /// Names of reference views: their cameras stay as delivered, and the datum is theirs.
    pub reference: Vec<String>,
    /// An elevation model that holds the height of the whole scene.
    pub height_prior: Option<HeightPrior>,
    /// Folder that keeps the keypoints of large images, for an adjustment that is interrupted.
    pub keypoints: Option<PathBuf>,
}

/// Adjusts a scene's cameras.
///
/// Views without enough keypoints, and those that do not fit the others, are left out, with a warning each; the others
/// are matched and adjusted anew then.
///
/// # Errors
/// [`BundleError`]: too few views, no common ground, matches that do not connect the views, ground control of
/// images that are not there, a request to stop.
pub fn adjust(scene: &Scene, options: &Options, progress: &dyn Progress) -> Result<Adjustment, BundleError> {
    scene.require_views(2)?;
    if options.height_range.is_none() {
        scene.require_shared_heights()?;
    }
    let heights = options.height_range.unwrap_or_else(|| scene.height_range());
    // A comparison that NaN fails too.
    if !matches!(heights.0.partial_cmp(&heights.1), Some(std::cmp::Ordering::Less)) {
        return Err(BundleError::Heights { low_m: heights.0, high_m: heights.1 });
    }
    scene.require_shared_ground(heights)?;
    let keypoints = find_keypoints(scene, options.keypoints.as_deref(), progress)?;
    let mut left_out = Vec::new();
    loop {
        let mut work = Work::new(scene, &keypoints, heights, left_out, progress)?;
        match work.adjust(scene, options)? {
            Outcome::Adjusted(adjustment) => return Ok(*adjustment),
            Outcome::Misfit(misfit) => {
                left_out = work.left_out;
                warn(progress, &misfit);
                left_out.push(misfit);
            }
        }
    }
}

/// Keypoints of every view, from `folder` if it keeps them.
fn find_keypoints(
    scene: &Scene,
    folder: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Keypoint>>, BundleError> {
    progress.event(Event::Started { stage: "finding features", total: scene.views.len() as u64 });
    let mut found = Vec::with_capacity(scene.views.len());
    // A few views at a time: the scale space of one takes thirty times its pixels.
    let largest = scene.views.iter().map(|v| v.width * v.height).max().unwrap_or(1);
    let at_once = (PIXELS_AT_ONCE / largest).clamp(1, rayon::current_num_threads());
    for some in scene.views.chunks(at_once) {
        progress.check()?;
        let of_some: Result<Vec<_>, RasterError> = some.par_iter().map(|v| keypoints(v, folder)).collect();
        found.extend(of_some?);
        progress.event(Event::Advanced { done: found.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(found)
}

fn warn(progress: &dyn Progress, (view, reason): &LeftOut) {
    progress.event(Event::Warning(format!("view `{view}` is left out: {reason}")));
}

/// Pairs of views, by index, with their matches.
type PairMatches = Vec<((usize, usize), Vec<Match>)>;

/// How an attempt ends.
enum Outcome {
    Adjusted(Box<Adjustment>),
    /// Without this view another attempt may do.
    Misfit(LeftOut),
}

/// A usable view.
struct WorkView<'a> {
    view: &'a View,
    keypoints: &'a [Keypoint],
}

impl WorkView<'_> {
    fn size(&self) -> (usize, usize) {
        (self.view.width, self.view.height)
    }
}

struct Work<'a> {
    views: Vec<WorkView<'a>>,
    network: Network<'a>,
    pairs: Vec<(usize, usize)>,
    control: Vec<Track>,
    left_out: Vec<LeftOut>,
    progress: &'a dyn Progress,
}

impl<'a> Work<'a> {
    /// The views that are neither in `left_out` already nor without keypoints or ground.
    fn new(
        scene: &'a Scene,
        keypoints: &'a [Vec<Keypoint>],
        heights: (f64, f64),
        mut left_out: Vec<LeftOut>,
        progress: &'a dyn Progress,
    ) -> Result<Self, BundleError> {
        let middle = 0.5 * (heights.0 + heights.1);
        let center = scene.center().unwrap_or_else(|| scene.views[0].rpc.center()).at_height(middle);
        let known = left_out.len();
        let mut views = Vec::new();
        let mut network = Network {
            rpcs: Vec::new(),
            frames: Vec::new(),
            held: Vec::new(),
            directions: Vec::new(),
            center,
            heights,
            height_prior: None,
        };
        for (view, keypoints) in scene.views.iter().zip(keypoints) {
            if left_out.iter().any(|l| l.0 == view.name) {
                continue;
            }
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
                Some(direction) => {
                    tracing::debug!("{}: {found} keypoints", view.name);
                    network.rpcs.push(&view.rpc);
                    network.frames.push(ImageFrame::new((view.width, view.height)));
                    network.held.push(false);
                    network.directions.push(direction);
                    views.push(WorkView { view, keypoints });
                }
            }
        }
        left_out[known..].iter().for_each(|view| warn(progress, view));
        if views.len() < 2 {
            return Err(too_few(views.len(), scene.views.len(), &left_out));
        }
        let pairs = pairs(&views, &network)?;
        Ok(Self { views, network, pairs, control: Vec::new(), left_out, progress })
    }

    /// Adjusts the cameras, unless a view turns out not to fit the others. Cameras that are only looked at all stay.
    fn adjust(&mut self, scene: &Scene, options: &'a Options) -> Result<Outcome, BundleError> {
        let leaves_out = !options.fixed;
        self.hold(&options.reference)?;
        self.network.height_prior = options.height_prior.as_ref();
        let names: Vec<&str> = self.views.iter().map(|v| v.view.name.as_str()).collect();
        self.control = tracks_of(&options.control, scene, &names, &self.network.block())?;
        let mut estimate = Estimate::start(self.views.len());
        let of_like_suns = self.pairs_of_like_suns();
        let all = std::mem::replace(&mut self.pairs, of_like_suns);
        let first = match self.round(&mut estimate, WIDE_PX, Model::Shift) {
            // Pairs of unlike suns may be what holds the views together.
            Err(BundleError::NotConnected { .. }) if self.pairs.len() < all.len() => {
                self.pairs = all;
                estimate = Estimate::start(self.views.len());
                self.round(&mut estimate, WIDE_PX, Model::Shift)
            }
            done => done,
        };
        match first? {
            Some(misfit) if leaves_out => return Ok(Outcome::Misfit(misfit)),
            Some((view, reason)) => self.progress.event(Event::Warning(format!("view `{view}`: {reason}"))),
            None => {}
        }
        self.narrow_heights(&estimate);
        let second = self.round(&mut estimate, NARROW_PX, Model::Shift)?;
        if let Some(misfit) = second.filter(|_| leaves_out) {
            return Ok(Outcome::Misfit(misfit));
        }
        self.settle(&mut estimate, options.model)?;
        if let Some(misfit) = self.loose(&estimate.tracks).filter(|_| leaves_out) {
            return Ok(Outcome::Misfit(misfit));
        }
        let mut adjustment = self.result(&estimate, options)?;
        // Windows are a matter of this run; what is written is of whole images.
        for ((_, rpc), used) in adjustment.cameras.iter_mut().zip(&self.views) {
            *rpc = used.view.camera_of_whole(rpc);
        }
        for tie in &mut adjustment.tie_points {
            tie.px = self.views[tie.view].view.px_of_whole(tie.px);
        }
        Ok(Outcome::Adjusted(Box::new(adjustment)))
    }

    /// Pairs whose suns stand near each other; a sun that is not known is near to all.
    fn pairs_of_like_suns(&self) -> Vec<(usize, usize)> {
        let direction = |v: usize| self.views[v].view.sun.map(|s| (s.azimuth_deg, 90.0 - s.elevation_deg));
        let apart_deg = |(i, j): (usize, usize)| {
            direction(i).zip(direction(j)).map_or(0.0, |(a, b)| angle_between_deg(a, b))
        };
        let mut by_sun = self.pairs.clone();
        by_sun.sort_by(|a, b| apart_deg(*a).total_cmp(&apart_deg(*b)));
        let mut taken = vec![0; self.views.len()];
        by_sun.retain(|(i, j)| {
            let is_among_nearest = taken[*i].min(taken[*j]) < NEAREST_SUNS;
            let is_kept = apart_deg((*i, *j)) <= SUNS_DEG || is_among_nearest;
            for v in [i, j] {
                taken[*v] += usize::from(is_kept);
            }
            is_kept
        });
        by_sun.sort_unstable();
        by_sun
    }

    /// Makes views references.
    fn hold(&mut self, reference: &[String]) -> Result<(), BundleError> {
        for name in reference {
            let refused = |reason: String| BundleError::Reference { view: name.clone(), reason };
            if let Some((_, why)) = self.left_out.iter().find(|l| l.0 == *name) {
                return Err(refused(format!("is left out: {why}")));
            }
            let view = self.views.iter().position(|v| v.view.name == *name);
            self.network.held[view.ok_or_else(|| refused("is not in the scene".into()))?] = true;
        }
        Ok(())
    }

    /// Matches within `across` pixels, makes tracks, solves and rejects. A view that does not fit the others, if any.
    fn round(
        &self,
        estimate: &mut Estimate,
        across: f64,
        model: Model,
    ) -> Result<Option<LeftOut>, BundleError> {
        let cameras = self.corrected(&estimate.corrections)?;
        let found = self.match_pairs(&cameras, across)?;
        let counts: Vec<usize> = self.views.iter().map(|v| v.keypoints.len()).collect();
        let tracks = tracks::build(&counts, &found);
        self.require_connection(&tracks)?;

        let measured = tracks.iter().map(|t| self.measured(t)).chain(self.control.iter().cloned());
        self.network.place(estimate, measured.collect());
        let placed = self.observations(&estimate.tracks);
        self.progress.event(Event::Started { stage: "adjusting", total: 0 });
        let scales: &[f64] = if across > NARROW_PX { &LOSS_SCALES_PX } else { &LOSS_SCALES_PX[1..] };
        self.network.refine(estimate, scales, model, KEYPOINT_PX)?;
        self.progress.event(Event::Finished);
        if estimate.tracks.iter().all(|t| t.known.is_some()) {
            return Err(BundleError::NotConnected { components: "no track survived the adjustment".into() });
        }
        Ok(if across > NARROW_PX {
            self.misfit(&placed, &self.observations(&estimate.tracks))
        } else {
            self.loose(&estimate.tracks)
        })
    }

    /// Tie points of each view.
    fn observations(&self, tracks: &[Track]) -> Vec<usize> {
        let mut counts = vec![0; self.views.len()];
        for seen in tracks.iter().filter(|t| t.known.is_none()).flat_map(|t| &t.seen) {
            counts[seen.view] += 1;
        }
        counts
    }

    /// The view that keeps the smallest share of what was `placed`, if that is far less than most views keep: an image
    /// that is turned a little, or another's, agrees in a strip. Two views keep the same share: nobody can tell there.
    fn misfit(&self, placed: &[usize], kept: &[usize]) -> Option<LeftOut> {
        let share = |v: &usize| kept[*v] as f64 / placed[*v] as f64;
        let mut views: Vec<usize> = (0..self.views.len()).filter(|v| placed[*v] > 0).collect();
        views.sort_by(|a, b| share(a).total_cmp(&share(b)));
        let usual = share(views.get(views.len() / 2)?);
        tracing::debug!(
            "views keep {:.2} of their matches or more, half of them {usual:.2}",
            share(&views[0])
        );
        let worst = views.into_iter().find(|v| !self.network.held[*v])?;
        let reason = || {
            let (kept, placed) = (kept[worst], placed[worst]);
            format!(
                "{kept} of {placed} matches agree with the others: is the image turned, or another camera's?"
            )
        };
        (share(&worst) < LEAST_KEPT * usual).then(|| (self.views[worst].view.name.clone(), reason()))
    }

    /// The view with the fewest tie points, if these are too few to place it, and far fewer than those of most views.
    fn loose(&self, tracks: &[Track]) -> Option<LeftOut> {
        let kept = self.observations(tracks);
        let mut views: Vec<usize> = (0..self.views.len()).collect();
        views.sort_by_key(|v| kept[*v]);
        let needed = FEWEST_OBSERVATIONS.min(kept[views[views.len() / 2]] / 2);
        let surveyed =
            |v: usize| tracks.iter().any(|t| t.known.is_some() && t.seen.iter().any(|m| m.view == v));
        let fewest = views.into_iter().find(|v| !self.network.held[*v] && !surveyed(*v))?;
        let reason = || format!("{} tie points are left, too few", kept[fewest]);
        (kept[fewest] < needed).then(|| (self.views[fewest].view.name.clone(), reason()))
    }

    fn keypoint(&self, o: &Observation) -> &Keypoint {
        &self.views[o.view as usize].keypoints[o.keypoint as usize]
    }

    fn measured(&self, track: &[Observation]) -> Track {
        let measure =
            |o: &Observation| Measurement { view: o.view as usize, px: self.keypoint(o).px, weight: 1.0 };
        let gray = self.keypoint(&track[0]).gray;
        Track { seen: track.iter().map(measure).collect(), gray, known: None }
    }

    /// Measures the tracks anew by patches in all views, and solves with these; keypoints count little from now on.
    fn settle(&self, estimate: &mut Estimate, model: Model) -> Result<(), BundleError> {
        let tied = (0..estimate.tracks.len()).filter(|i| estimate.tracks[*i].known.is_none()).collect();
        let pieces = squares(&estimate.points, tied, PIECE_PX * self.gsd_m());
        self.progress.event(Event::Started { stage: "measuring patches", total: pieces.len() as u64 });
        let block = self.network.block();
        let fewest = FEWEST_VIEWS.min(self.views.len().div_ceil(2)).max(2);
        let images = self.views.par_iter().map(|v| Ok((v.view.gray_image()?, v.size())));
        let mut images = images.collect::<Result<Vec<_>, RasterError>>()?;
        for (done, piece) in pieces.iter().enumerate() {
            self.progress.check()?;
            let at = |i: &usize| estimate.points[*i];
            let parts = images.par_iter_mut().enumerate().map(|(v, (image, size))| {
                let shown = piece.iter().map(|i| block.project(v, &estimate.corrections[v], at(i)));
                Part::around(shown, *size, |window| image.read(window))
            });
            let parts = parts.collect::<Result<Vec<Part>, RasterError>>()?;
            let seeker = Seeker::new(&block, &estimate.corrections, parts);
            let seek = |i: &usize| seeker.track(&estimate.tracks[*i].seen[0], at(i));
            let found: Vec<Vec<Measurement>> = piece.par_iter().with_min_len(16).map(seek).collect();
            for (i, found) in piece.iter().zip(found) {
                let track = &mut estimate.tracks[*i];
                if found.len() >= fewest {
                    track.seen = found;
                } else {
                    track.seen.iter_mut().for_each(|m| m.weight = UNCONFIRMED);
                }
            }
            self.progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        let confirmed =
            estimate.tracks.iter().filter(|t| t.known.is_none() && t.seen[0].weight > UNCONFIRMED);
        tracing::debug!("patches confirm {} of {} tracks", confirmed.count(), estimate.tracks.len());
        self.network.refine(estimate, &LOSS_SCALES_PX[1..], model, PATCH_PX)?;
        self.drop_vague(estimate, model);
        self.progress.event(Event::Finished);
        Ok(())
    }

    /// Size of a pixel on the ground, the mean of all views, metres.
    fn gsd_m(&self) -> f64 {
        let height_m = self.network.center.height_m();
        let of_views = self.views.iter().filter_map(|v| v.view.gsd_m(height_m));
        let (sum, n) = of_views.fold((0.0, 0.0), |(sum, n), (a, b)| (sum + (a * b).sqrt(), n + 1.0));
        sum / n
    }

    /// Drops what its rays leave far up or down: keypoints at narrow angles that no patch confirms.
    fn drop_vague(&self, estimate: &mut Estimate, model: Model) {
        let Some(precision) = self.network.precision(estimate, model, true) else { return };
        let most_m = VAGUE_PX * self.gsd_m();
        let all = std::mem::take(&mut estimate.tracks).into_iter().zip(std::mem::take(&mut estimate.points));
        let clear =
            all.zip(precision.points).filter(|((t, _), sigma)| t.known.is_some() || sigma[2] <= most_m);
        (estimate.tracks, estimate.points) = clear.map(|(track, _)| track).unzip();
    }

    fn corrected(&self, corrections: &[Parameters]) -> Result<Vec<Rpc>, BundleError> {
        let (network, views) = (&self.network, &self.views);
        let heights = (network.heights.0 - REFIT_MARGIN_M, network.heights.1 + REFIT_MARGIN_M);
        let camera = |(v, p): (usize, &Parameters)| {
            let corrected = network.frames[v].corrected(network.rpcs[v], p, heights);
            corrected.map_err(|reason| BundleError::Refit { view: views[v].view.name.clone(), reason })
        };
        corrections.par_iter().enumerate().map(camera).collect()
    }

    fn match_pairs(&self, cameras: &[Rpc], across: f64) -> Result<PairMatches, Interrupted> {
        let prepared: Vec<MatchView> = self
            .views
            .iter()
            .zip(cameras)
            .map(|(v, rpc)| {
                let some = if across > NARROW_PX { WIDE_KEYPOINTS } else { v.keypoints.len() };
                let keypoints = &v.keypoints[..some.min(v.keypoints.len())];
                MatchView::new(rpc, keypoints, v.size(), self.network.heights)
            })
            .collect();
        self.progress.event(Event::Started { stage: "matching", total: self.pairs.len() as u64 });
        let mut found = Vec::with_capacity(self.pairs.len());
        for (done, &(i, j)) in self.pairs.iter().enumerate() {
            self.progress.check()?;
            found.push(((i, j), matches(&prepared[i], &prepared[j], across)));
            self.progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        self.progress.event(Event::Finished);
        for ((i, j), m) in &found {
            let [a, b] = [i, j].map(|v| &self.views[*v].view.name);
            tracing::debug!("{a} - {b}: {} matches", m.len());
        }
        Ok(found)
    }

    fn require_connection(&self, found: &[Vec<Observation>]) -> Result<(), BundleError> {
        let groups = tracks::components(self.views.len(), found);
        if groups.len() <= 1 {
            return Ok(());
        }
        let list = |g: &Vec<usize>| {
            let names: Vec<&str> = g.iter().map(|v| self.views[*v].view.name.as_str()).collect();
            format!("{{{}}}", names.join(", "))
        };
        let components = groups.iter().map(list).collect::<Vec<_>>().join(" | ");
        Err(BundleError::NotConnected { components })
    }

    /// Takes the heights of nearly all points, and a margin.
    fn narrow_heights(&mut self, estimate: &Estimate) {
        let mut z: Vec<f64> = estimate.points.iter().map(|p| p[2] + self.network.center.height_m()).collect();
        z.sort_by(f64::total_cmp);
        let at = |share: f64| z[(share * (z.len() - 1) as f64) as usize];
        let (low, high) = self.network.heights;
        self.network.heights = (
            (at(0.005) - HEIGHT_MARGIN_M).max(low - HEIGHT_MARGIN_M),
            (at(0.995) + HEIGHT_MARGIN_M).min(high + HEIGHT_MARGIN_M),
        );
    }

    /// What fixes the datum.
    fn gauge(&self, options: &Options) -> String {
        let plan = self.gauge_of_cameras(options);
        match &options.height_prior {
            Some(prior) if !options.fixed => {
                format!("{plan}; heights of the elevation model to {} m", prior.sigma_m)
            }
            _ => plan,
        }
    }

    fn gauge_of_cameras(&self, options: &Options) -> String {
        match (options.fixed, self.control.is_empty(), options.reference.as_slice()) {
            (true, ..) => "cameras as given".into(),
            (false, true, []) => "mean of the delivered cameras: robust priors on the shifts".into(),
            (false, false, []) => "ground control".into(),
            (false, true, names) => format!("reference views {}", names.join(", ")),
            (false, false, names) => format!("ground control and reference views {}", names.join(", ")),
        }
    }

    fn result(&self, estimate: &Estimate, options: &Options) -> Result<Adjustment, BundleError> {
        let block = self.network.block();
        let given = self.network.as_delivered(&estimate.tracks);
        let Estimate { corrections, tracks, points } = if options.fixed { &given } else { estimate };
        let before = self.network.distances(&given);
        let after = if options.fixed { before.clone() } else { self.network.distances(estimate) };
        let of = |all: &[(usize, f64)], view: usize| -> Vec<f64> {
            all.iter().filter(|d| d.0 == view).map(|d| d.1).collect()
        };
        let precision = |of: &Estimate, fixed: bool| {
            let unsure = || BundleError::Solver { reason: "a point is not fixed by its rays".into() };
            self.network.precision(of, options.model, fixed).ok_or_else(unsure)
        };
        let of_shifts = precision(estimate, false)?;
        let of_points = if options.fixed { precision(&given, true)?.points } else { of_shifts.points };
        let views = self.views.iter().enumerate().map(|(v, view)| {
            let sigma = of_shifts.corrections[v];
            ViewReport::new(&view.view.name, estimate.corrections[v], sigma, &of(&before, v), &of(&after, v))
        });
        let control = tracks.iter().zip(points).filter_map(|(t, p)| Some((t, t.known?, p)));
        let control =
            control.flat_map(|(t, known, p)| t.seen.iter().map(move |m| (m, known, *p)).collect::<Vec<_>>());
        let control: Vec<_> = control
            .map(|(m, known, p)| {
                let residual_px = block.distance(m, &corrections[m.view], p);
                control_report(self.views[m.view].view, m, &known, p, residual_px, &options.control)
            })
            .collect();
        let none_agrees = !control.is_empty() && control.iter().all(|c| !c.agrees);
        for c in control.iter().filter(|c| !c.agrees) {
            self.progress.event(Event::Warning(format!(
                "ground control, line {}: `{}` shows the point {:.1} px from where it should be",
                c.line, c.view, c.residual_px
            )));
        }
        let gauge = match none_agrees && !options.fixed {
            true => "no point of the ground control agrees: priors on the shifts, and what they leave to it"
                .into(),
            false => self.gauge(options),
        };
        let report = Report {
            gauge,
            open_directions: of_shifts.open,
            sigma_px: of_shifts.sigma_px,
            model: options.model,
            tracks: tracks.iter().filter(|t| t.known.is_none()).count(),
            control,
            views: views.collect(),
            left_out: self.left_out.clone(),
            ..Report::of(&before, &after)
        };
        let measured = tracks.iter().zip(&of_points).filter(|(t, _)| t.known.is_none());
        let quality = measured
            .map(|(track, sigma_m)| PointQuality {
                sigma_m: *sigma_m,
                angle_deg: self.network.angle_deg(track),
            })
            .collect();
        let names = self.views.iter().map(|v| v.view.name.clone());
        let tied = tracks.iter().zip(points).filter(|(t, _)| t.known.is_none()).enumerate();
        let (points, tie_points): (Vec<_>, Vec<_>) = tied
            .map(|(id, (track, p))| {
                let seen = track.seen.iter().map(|m| {
                    let predicted = block.project(m.view, &corrections[m.view], *p);
                    let residual_px = [m.px.col - predicted.col, m.px.row - predicted.row];
                    TiePoint { point: id, view: m.view, px: m.px, residual_px }
                });
                let position = block.geodetic(*p);
                let views = track.seen.len() as u8;
                (SparsePoint { position, views, gray: track.gray }, seen.collect::<Vec<_>>())
            })
            .unzip();
        let cameras = names.zip(self.corrected(corrections)?).collect();
        Ok(Adjustment { cameras, points, tie_points: tie_points.concat(), quality, report })
    }
}

fn too_few(usable: usize, all: usize, left_out: &[LeftOut]) -> BundleError {
    let list: Vec<String> = left_out.iter().map(|(n, r)| format!("{n} ({r})")).collect();
    BundleError::TooFewViews { usable, all, left_out: list.join(", ") }
}

/// Pairs of views that share ground and whose directions differ enough, but not too much.
fn pairs(views: &[WorkView], network: &Network) -> Result<Vec<(usize, usize)>, BundleError> {
    let center: Point<Geodetic> = network.center;
    let grid = SiteGrid::at(center).map_err(crate::scene::SceneError::from)?;
    let outlines: Vec<_> = views
        .iter()
        .zip(&network.rpcs)
        .map(|(v, rpc)| footprint(rpc, v.size(), &grid, center.height_m()))
        .collect();
    let mut out = Vec::new();
    let mut widest: f64 = 0.0;
    for i in 0..views.len() {
        for j in i + 1..views.len() {
            let (Some(a), Some(b)) = (&outlines[i], &outlines[j]) else { continue };
            let shared = a.intersection(b).unsigned_area() / a.unsigned_area().min(b.unsigned_area());
            let angle = angle_between_deg(network.directions[i], network.directions[j]);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Role, Sun};

    #[test]
    fn pairs_of_unlike_suns_are_left_out_where_enough_are_alike() {
        let rpc = crate::rpc::test_camera();
        let view = |i: usize| View {
            name: format!("{i}"),
            image: PathBuf::new(),
            width: 1000,
            height: 1000,
            window: None,
            bands: vec![1],
            stretch_percent: None,
            mask: None,
            nodata: None,
            rpc: rpc.clone(),
            rpc_source: String::new(),
            // Six in the morning, six in the afternoon: 40 degrees apart.
            sun: Sun::new([100.0, 170.0][i / 6] + (i % 6) as f64, 50.0),
            acquired: None,
            role: Role::Train,
            height_range: None,
        };
        let views: Vec<View> = (0..12).map(view).collect();
        let network = Network {
            rpcs: views.iter().map(|v| &v.rpc).collect(),
            frames: vec![ImageFrame::new((1000, 1000)); 12],
            held: vec![false; 12],
            directions: vec![(0.0, 10.0); 12],
            center: rpc.center(),
            heights: rpc.height_range(),
            height_prior: None,
        };
        let work = Work {
            views: views.iter().map(|view| WorkView { view, keypoints: &[] }).collect(),
            network,
            pairs: (0..12).flat_map(|i| (i + 1..12).map(move |j| (i, j))).collect(),
            control: Vec::new(),
            left_out: Vec::new(),
            progress: &crate::progress::NoProgress,
        };
        let kept = work.pairs_of_like_suns();
        assert_eq!(kept.len(), 2 * 15);
        assert!(kept.iter().all(|(i, j)| i / 6 == j / 6), "{kept:?}");
    }
}
