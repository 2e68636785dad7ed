//! The stages of an adjustment: keypoints, matches, tracks and the solution with outlier rejection, in two rounds; then
//! least-squares matching of the tie points, and the last solution.

use super::adjuster::{Adjuster, warn_left_out};
use super::control::{ControlPoint, tracks_of};
use super::correction::CorrectionModel;
use super::error::BundleError;
use super::features::Keypoint;
use super::height_prior::HeightPrior;
use super::keypoint_file::keypoints;
use super::matching::{Match, MatchView, matches};
use super::network::{Estimate, HEIGHT_MARGIN_M, LOSS_SCALES_PX};
use super::output::Adjustment;
use super::problem::{Observation, Track};
use super::report::LeftOut;
use super::tracks::{self, TrackElement};
use super::view_pairs::with_similar_suns;
use crate::io::RasterError;
use crate::progress::{Event, Interrupted, Progress};
use crate::rpc::Rpc;
use crate::scene::Scene;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Largest distance of a match from its epipolar segment in the first round, pixels: delivered RPCs may be tens of
/// pixels off.
const WIDE_TOLERANCE_PX: f64 = 60.0;
/// Number of keypoints of a view that are matched in the first round, which determines shifts only: the first of each
/// view's keypoints, which are spread over the image as all of them are.
const WIDE_KEYPOINTS: usize = 2500;
/// Largest distance of a match from its epipolar segment in the second round, pixels.
const NARROW_TOLERANCE_PX: f64 = 4.0;
/// Keypoints with residuals below this are never rejected, pixels; least-squares matching replaces them later.
const MIN_KEYPOINT_LIMIT_PX: f64 = 0.6;
/// Pixels of the views whose keypoints are detected at the same time.
const PIXELS_AT_ONCE: usize = 8_000_000;

/// BundleOptions of an adjustment.
#[derive(Clone, Debug, Default)]
pub struct BundleOptions {
    /// Keep the cameras as delivered: points are triangulated with them, and the report tells which corrections an
    /// adjustment would make.
    pub fixed: bool,
    /// Which parameters of a camera are corrected.
    pub model: CorrectionModel,
    /// Lowest and highest ellipsoidal height of the ground, metres; without it that of the scene.
    pub height_range: Option<(f64, f64)>,
    /// Surveyed points, which then define the datum.
    pub control: Vec<ControlPoint>,
    /// Names of reference views: their cameras are not corrected and define the datum.
    pub reference: Vec<String>,
    /// An elevation model as a prior of the heights.
    pub height_prior: Option<HeightPrior>,
    /// Folder in which the keypoints of large images are stored, so that an interrupted adjustment need not detect them
    /// again.
    pub keypoints: Option<PathBuf>,
}

/// Corrects the RPCs of a scene by bundle adjustment.
///
/// Views without enough keypoints, and views that contradict the others, are left out, with a warning each; the remaining
/// views are then matched and adjusted again.
///
/// # Errors
/// [`BundleError`]: too few views, no common ground, matches that do not connect the views, ground control of
/// images that are not there, a request to stop.
pub fn adjust(
    scene: &Scene,
    options: &BundleOptions,
    progress: &dyn Progress,
) -> Result<Adjustment, BundleError> {
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
        let mut adjuster = Adjuster::new(scene, &keypoints, heights, left_out, progress)?;
        match adjuster.adjust(scene, options)? {
            Outcome::Adjusted(adjustment) => return Ok(*adjustment),
            Outcome::Rejected(rejected) => {
                left_out = adjuster.left_out;
                warn_left_out(progress, &rejected);
                left_out.push(rejected);
            }
        }
    }
}

/// Keypoints of every view, from `folder` if they are stored there.
fn find_keypoints(
    scene: &Scene,
    folder: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Keypoint>>, BundleError> {
    progress.event(Event::Started { stage: "finding features", total: scene.views.len() as u64 });
    let mut found = Vec::with_capacity(scene.views.len());
    // The scale space takes thirty times the memory of the image, so that only a few views are held at a time.
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

/// Pairs of views, by index, with their matches.
type PairMatches = Vec<((usize, usize), Vec<Match>)>;

/// Result of one attempt.
enum Outcome {
    Adjusted(Box<Adjustment>),
    /// This view contradicts the others; another attempt is made without it.
    Rejected(LeftOut),
}

impl<'a> Adjuster<'a> {
    /// Runs the stages after the keypoints. A view that contradicts the others ends the attempt, unless the cameras are
    /// fixed: then it is kept with a warning.
    fn adjust(&mut self, scene: &Scene, options: &'a BundleOptions) -> Result<Outcome, BundleError> {
        let leaves_out = !options.fixed;
        self.fix_views(&options.reference)?;
        self.network.height_prior = options.height_prior.as_ref();
        let names: Vec<&str> = self.views.iter().map(|v| v.view.name.as_str()).collect();
        self.control = tracks_of(&options.control, scene, &names, &self.network.block())?;
        let mut estimate = Estimate::start(self.views.len());
        let of_like_suns = with_similar_suns(&self.views, &self.pairs);
        let all = std::mem::replace(&mut self.pairs, of_like_suns);
        let first = match self.match_and_adjust(&mut estimate, WIDE_TOLERANCE_PX, CorrectionModel::Shift) {
            // Without the pairs with dissimilar suns the views may not be connected.
            Err(BundleError::NotConnected { .. }) if self.pairs.len() < all.len() => {
                self.pairs = all;
                estimate = Estimate::start(self.views.len());
                self.match_and_adjust(&mut estimate, WIDE_TOLERANCE_PX, CorrectionModel::Shift)
            }
            done => done,
        };
        match first? {
            Some(rejected) if leaves_out => return Ok(Outcome::Rejected(rejected)),
            Some((view, reason)) => self.progress.event(Event::Warning(format!("view `{view}`: {reason}"))),
            None => {}
        }
        self.narrow_heights(&estimate);
        let second = self.match_and_adjust(&mut estimate, NARROW_TOLERANCE_PX, CorrectionModel::Shift)?;
        if let Some(rejected) = second.filter(|_| leaves_out) {
            return Ok(Outcome::Rejected(rejected));
        }
        self.refine_tie_points(&mut estimate, options.model)?;
        if let Some(rejected) = self.weakest_view(&estimate.tracks).filter(|_| leaves_out) {
            return Ok(Outcome::Rejected(rejected));
        }
        let mut adjustment = self.result(&estimate, options)?;
        // The adjustment works in the pixels of the views' windows; the result is in pixels of the whole images.
        for ((_, rpc), used) in adjustment.cameras.iter_mut().zip(&self.views) {
            *rpc = used.view.camera_of_whole(rpc);
        }
        for tie in &mut adjustment.observations {
            tie.px = self.views[tie.view].view.px_of_whole(tie.px);
        }
        Ok(Outcome::Adjusted(Box::new(adjustment)))
    }

    /// Marks views as reference views, whose cameras are not corrected.
    fn fix_views(&mut self, reference: &[String]) -> Result<(), BundleError> {
        for name in reference {
            let refused = |reason: String| BundleError::Reference { view: name.clone(), reason };
            if let Some((_, why)) = self.left_out.iter().find(|l| l.0 == *name) {
                return Err(refused(format!("is left out: {why}")));
            }
            let view = self.views.iter().position(|v| v.view.name == *name);
            self.network.is_fixed[view.ok_or_else(|| refused("is not in the scene".into()))?] = true;
        }
        Ok(())
    }

    /// One round: matches keypoints within `epipolar_tolerance_px` of the epipolar segments, builds tracks, adjusts and
    /// rejects outliers. Returns the view that contradicts the others, if there is one.
    fn match_and_adjust(
        &self,
        estimate: &mut Estimate,
        epipolar_tolerance_px: f64,
        model: CorrectionModel,
    ) -> Result<Option<LeftOut>, BundleError> {
        let cameras = self.corrected(&estimate.corrections)?;
        let found = self.match_pairs(&cameras, epipolar_tolerance_px)?;
        let counts: Vec<usize> = self.views.iter().map(|v| v.keypoints.len()).collect();
        let tracks = tracks::build(&counts, &found);
        self.require_connection(&tracks)?;

        let observed = tracks.iter().map(|t| self.observed(t)).chain(self.control.iter().cloned());
        self.network.triangulate_tracks(estimate, observed.collect());
        let triangulated = self.observation_counts(&estimate.tracks);
        self.progress.event(Event::Started { stage: "adjusting", total: 0 });
        let scales: &[f64] =
            if epipolar_tolerance_px > NARROW_TOLERANCE_PX { &LOSS_SCALES_PX } else { &LOSS_SCALES_PX[1..] };
        self.network.refine(estimate, scales, model, MIN_KEYPOINT_LIMIT_PX)?;
        self.progress.event(Event::Finished);
        if estimate.tracks.iter().all(|t| t.prior.is_some()) {
            return Err(BundleError::NotConnected { components: "no track survived the adjustment".into() });
        }
        Ok(if epipolar_tolerance_px > NARROW_TOLERANCE_PX {
            self.worst_view(&triangulated, &self.observation_counts(&estimate.tracks))
        } else {
            self.weakest_view(&estimate.tracks)
        })
    }

    fn keypoint(&self, o: &TrackElement) -> &Keypoint {
        &self.views[o.view as usize].keypoints[o.keypoint as usize]
    }

    /// A track with the positions of its keypoints as observations.
    fn observed(&self, track: &[TrackElement]) -> Track {
        let measure =
            |o: &TrackElement| Observation { view: o.view as usize, px: self.keypoint(o).px, weight: 1.0 };
        let gray = self.keypoint(&track[0]).gray;
        Track { observations: track.iter().map(measure).collect(), gray, prior: None }
    }

    fn match_pairs(&self, cameras: &[Rpc], epipolar_tolerance_px: f64) -> Result<PairMatches, Interrupted> {
        let prepared: Vec<MatchView> = self
            .views
            .iter()
            .zip(cameras)
            .map(|(v, rpc)| {
                let some = if epipolar_tolerance_px > NARROW_TOLERANCE_PX {
                    WIDE_KEYPOINTS
                } else {
                    v.keypoints.len()
                };
                let keypoints = &v.keypoints[..some.min(v.keypoints.len())];
                MatchView::new(rpc, keypoints, v.size(), self.network.heights)
            })
            .collect();
        self.progress.event(Event::Started { stage: "matching", total: self.pairs.len() as u64 });
        let mut found = Vec::with_capacity(self.pairs.len());
        for (done, &(i, j)) in self.pairs.iter().enumerate() {
            self.progress.check()?;
            found.push(((i, j), matches(&prepared[i], &prepared[j], epipolar_tolerance_px)));
            self.progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        self.progress.event(Event::Finished);
        for ((i, j), m) in &found {
            let [a, b] = [i, j].map(|v| &self.views[*v].view.name);
            tracing::debug!("{a} - {b}: {} matches", m.len());
        }
        Ok(found)
    }

    fn require_connection(&self, found: &[Vec<TrackElement>]) -> Result<(), BundleError> {
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

    /// Narrows the range of heights to that of the points, outliers excepted, with a margin.
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
}
