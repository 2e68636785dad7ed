//! The stages of an adjustment of views at once: keypoints, matches, tracks and the solution with outlier rejection, in two
//! rounds; then least-squares matching of the tie points, and the last solution.

use super::adjuster::{Adjuster, Outcome, attempt, has_majority};
use super::correction::CorrectionModel;
use super::error::BundleError;
use super::features::{Keypoint, detect};
use super::matching::{Match, MatchView, matches};
use super::network::{Estimate, LOSS_SCALES_PX};
use super::options::BundleOptions;
use super::problem::{Observation, Track};
use super::report::LeftOut;
use super::tracks::{self, TrackElement};
use super::view_pairs::with_similar_suns;
use crate::checkpoint::PartStore;
use crate::progress::{Event, Progress};
use crate::rpc::Rpc;
use crate::run_files::MATCHING;
use crate::scene::{Scene, View};
use rayon::prelude::*;

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
/// Largest number of keypoints of a view in a cell: the first of each view's, which are spread over its image. A cell
/// keeps far fewer tie points, and those of thirty views take 300 MB.
const CELL_KEYPOINTS: usize = 20_000;
/// Pixels of the views whose keypoints are detected at the same time.
const PIXELS_AT_ONCE: usize = 8_000_000;

/// What the views of an adjustment show together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extent {
    /// All of the scene: views that matches do not connect are left out if most others are connected, else an error.
    Scene,
    /// A cell of its ground: a part of the keypoints is enough, and views that matches do not connect with most of the
    /// others are left out, because other cells may connect them.
    Cell,
}

/// Keypoints of every view, and where they are stored.
pub(super) fn find_keypoints(
    scene: &Scene,
    extent: Extent,
    store: Option<&PartStore>,
    progress: &dyn Progress,
) -> Result<Vec<Vec<Keypoint>>, BundleError> {
    progress.event(Event::Started { stage: "finding features", total: scene.views.len() as u64 });
    let mut found = Vec::with_capacity(scene.views.len());
    // The scale space takes thirty times the memory of the image, so that only a few views are held at a time.
    let largest = scene.views.iter().map(|v| v.width * v.height).max().unwrap_or(1);
    let at_once = (PIXELS_AT_ONCE / largest).clamp(1, rayon::current_num_threads());
    let keypoints = |view: &View| -> Result<Vec<Keypoint>, BundleError> {
        let image = view.gray_image()?;
        let mut found = detect((view.width, view.height), |window| image.read_without_specks(window))?;
        if extent == Extent::Cell && found.len() > CELL_KEYPOINTS {
            found.truncate(CELL_KEYPOINTS);
            found.shrink_to_fit();
        }
        Ok(found)
    };
    for some in scene.views.chunks(at_once) {
        progress.check()?;
        let first = found.len();
        let of_view = |(k, view): (usize, &View)| -> Result<Vec<Keypoint>, BundleError> {
            let name = format!("keypoints_{:03}", first + k);
            PartStore::part(store, &name, &view.name, || keypoints(view))
        };
        let of_some: Result<Vec<_>, BundleError> = some.par_iter().enumerate().map(of_view).collect();
        found.extend(of_some?);
        progress.event(Event::Advanced { done: found.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    if let Some(store) = store {
        store.tell(progress);
    }
    Ok(found)
}

/// Matches and adjusts all views at once, leaving out those that contradict the others. Returns the views that remain and
/// the estimate.
///
/// # Errors
/// [`BundleError`].
pub(super) fn match_and_adjust<'a>(
    scene: &'a Scene,
    keypoints: &'a [Vec<Keypoint>],
    heights: (f64, f64),
    options: &'a BundleOptions,
    extent: Extent,
    progress: &'a dyn Progress,
) -> Result<(Adjuster<'a>, Estimate), BundleError> {
    attempt(
        |left_out| Adjuster::new(scene, Some(keypoints), heights, left_out, progress),
        |adjuster| adjuster.adjust(scene, options, extent),
    )
}

/// Pairs of views, by index, with their matches.
type PairMatches = Vec<((usize, usize), Vec<Match>)>;

/// How a round of matching and adjustment ended.
enum Round {
    Adjusted,
    /// This view contradicts the others.
    Contradicted(LeftOut),
    /// Matches join the views in these groups only, the largest first.
    NotConnected(Vec<Vec<usize>>),
    /// No match agrees with the cameras.
    NoTracks,
}

impl<'a> Adjuster<'a> {
    /// Runs the stages after the keypoints. A view that contradicts the others ends the attempt, unless the cameras are
    /// fixed: then it is kept with a warning.
    fn adjust(
        &mut self,
        scene: &Scene,
        options: &'a BundleOptions,
        extent: Extent,
    ) -> Result<Outcome, BundleError> {
        let leaves_out = !options.fixed;
        self.set_datum(scene, options)?;
        let store = options.store.as_ref().map(|store| store.within(MATCHING));
        let store = store.as_ref();
        let mut estimate = Estimate::start(self.views.len());
        let of_like_suns = with_similar_suns(&self.views, &self.pairs);
        let all = std::mem::replace(&mut self.pairs, of_like_suns);
        let mut first = self.round(&mut estimate, WIDE_TOLERANCE_PX, store)?;
        // Without the pairs with dissimilar suns the views may not be connected.
        if matches!(first, Round::NotConnected(_) | Round::NoTracks) && self.pairs.len() < all.len() {
            self.pairs = all;
            estimate = Estimate::start(self.views.len());
            first = self.round(&mut estimate, WIDE_TOLERANCE_PX, store)?;
        }
        match first {
            Round::Contradicted((view, reason)) if !leaves_out => {
                self.progress.event(Event::Warning(format!("view `{view}`: {reason}")));
            }
            Round::Adjusted => {}
            failed => return self.rejected(failed, extent, leaves_out),
        }
        self.narrow_heights(&estimate);
        match self.round(&mut estimate, NARROW_TOLERANCE_PX, store)? {
            Round::Contradicted(_) if !leaves_out => {}
            Round::Adjusted => {}
            failed => return self.rejected(failed, extent, leaves_out),
        }
        self.refine_tie_points(&mut estimate, options.model)?;
        Ok(match self.weakest_view(&estimate.tracks).filter(|_| leaves_out) {
            Some(view) => Outcome::Rejected(vec![view]),
            None => Outcome::Adjusted(estimate),
        })
    }

    /// The views that a round that failed leaves out, or the error that it is.
    fn rejected(&self, round: Round, extent: Extent, leaves_out: bool) -> Result<Outcome, BundleError> {
        match round {
            Round::Contradicted(view) => Ok(Outcome::Rejected(vec![view])),
            Round::NotConnected(groups) if extent == Extent::Cell && groups[0].len() > 1 => {
                Ok(Outcome::Rejected(self.apart(&groups)))
            }
            Round::NotConnected(groups) if leaves_out && has_majority(&groups) => {
                Ok(Outcome::Rejected(self.apart(&groups)))
            }
            Round::NotConnected(groups) => Err(self.not_connected(&groups)),
            Round::NoTracks | Round::Adjusted => Err(self.no_tracks()),
        }
    }

    /// One round: matches keypoints within `epipolar_tolerance_px` of the epipolar segments, builds tracks, adjusts the
    /// views' shifts and rejects outliers.
    fn round(
        &self,
        estimate: &mut Estimate,
        epipolar_tolerance_px: f64,
        store: Option<&PartStore>,
    ) -> Result<Round, BundleError> {
        let cameras = self.corrected(&estimate.corrections)?;
        let found = self.match_pairs(&cameras, epipolar_tolerance_px, store)?;
        let counts: Vec<usize> = self.views.iter().map(|v| v.keypoints.len()).collect();
        let tracks = tracks::build(&counts, &found);
        let groups = tracks::components(
            self.views.len(),
            tracks.iter().map(|t| t.iter().map(|element| element.view as usize)),
        );
        if groups.len() > 1 {
            return Ok(Round::NotConnected(groups));
        }

        let observed = tracks.iter().map(|t| self.observed(t)).chain(self.control.iter().cloned());
        self.network.triangulate_tracks(estimate, observed.collect());
        let triangulated = self.observation_counts(&estimate.tracks);
        self.progress.event(Event::Started { stage: "adjusting", total: 0 });
        let scales: &[f64] =
            if epipolar_tolerance_px > NARROW_TOLERANCE_PX { &LOSS_SCALES_PX } else { &LOSS_SCALES_PX[1..] };
        self.network.refine(estimate, scales, CorrectionModel::Shift, MIN_KEYPOINT_LIMIT_PX)?;
        self.progress.event(Event::Finished);
        if estimate.tracks.iter().all(|t| t.prior.is_some()) {
            return Ok(Round::NoTracks);
        }
        let contradicts = if epipolar_tolerance_px > NARROW_TOLERANCE_PX {
            self.worst_view(&triangulated, &self.observation_counts(&estimate.tracks))
        } else {
            self.weakest_view(&estimate.tracks)
        };
        Ok(contradicts.map_or(Round::Adjusted, Round::Contradicted))
    }

    fn keypoint(&self, o: &TrackElement) -> &Keypoint {
        &self.views[o.view as usize].keypoints[o.keypoint as usize]
    }

    /// A track with the positions of its keypoints as observations.
    fn observed(&self, track: &[TrackElement]) -> Track {
        let measure =
            |o: &TrackElement| Observation { view: o.view as usize, px: self.keypoint(o).px, weight: 1.0 };
        let gray = self.keypoint(&track[0]).gray;
        Track { observations: track.iter().map(measure).collect(), gray, ..Track::default() }
    }

    fn match_pairs(
        &self,
        cameras: &[Rpc],
        epipolar_tolerance_px: f64,
        store: Option<&PartStore>,
    ) -> Result<PairMatches, BundleError> {
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
            let names = [i, j].map(|v| self.views[v].view.name.as_str());
            let made_from = format!(
                "{:?}",
                (names, [&cameras[i], &cameras[j]], self.network.heights, epipolar_tolerance_px)
            );
            // Named by a hash: a view has other places among those of other attempts.
            let round = if epipolar_tolerance_px > NARROW_TOLERANCE_PX { "wide" } else { "narrow" };
            let name = format!("{round}_{}", &blake3::hash(names.join("\n").as_bytes()).to_hex()[..16]);
            let of_pair = PartStore::part(store, &name, &made_from, || {
                Ok::<_, BundleError>(matches(&prepared[i], &prepared[j], epipolar_tolerance_px))
            })?;
            found.push(((i, j), of_pair));
            self.progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        self.progress.event(Event::Finished);
        for ((i, j), m) in &found {
            let [a, b] = [i, j].map(|v| &self.views[*v].view.name);
            tracing::debug!("{a} - {b}: {} matches", m.len());
        }
        Ok(found)
    }
}
