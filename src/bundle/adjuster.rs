//! The views of an adjustment, their delivered cameras, and the pairs of them that are matched.

use super::control::tracks_of;
use super::correction::{ImageFrame, Parameters};
use super::error::{BundleError, height_hint};
use super::features::Keypoint;
use super::network::{Estimate, HEIGHT_MARGIN_M, Network};
use super::options::BundleOptions;
use super::problem::Track;
use super::report::LeftOut;
use super::used_view::UsedView;
use super::view_pairs::overlapping_pairs;
use crate::progress::{Event, Progress};
use crate::rpc::Rpc;
use crate::scene::Scene;
use rayon::prelude::*;

/// Views with fewer keypoints are left out.
const MIN_KEYPOINTS: usize = 50;
/// Where a corrected camera must be refitted, it is fitted over the scene's heights and this far below and above them,
/// metres.
const REFIT_MARGIN_M: f64 = 500.0;

/// The views of one attempt at an adjustment, and what all its stages share.
pub(super) struct Adjuster<'a> {
    /// Views that are used.
    pub(super) views: Vec<UsedView<'a>>,
    /// Their cameras as delivered, and the datum.
    pub(super) network: Network<'a>,
    /// Pairs of views to match, by index.
    pub(super) pairs: Vec<(usize, usize)>,
    /// Surveyed points.
    pub(super) control: Vec<Track>,
    /// Views that are not used, with the reasons.
    pub(super) left_out: Vec<LeftOut>,
    /// Told of what is done.
    pub(super) progress: &'a dyn Progress,
}

impl<'a> Adjuster<'a> {
    /// Takes all views of a scene but those in `left_out`, those with too few keypoints, and those whose RPC cannot be
    /// localised at the scene's heights; the latter two are added to `left_out`. Without keypoints there are no pairs of
    /// views to match.
    pub(super) fn new(
        scene: &'a Scene,
        keypoints: Option<&'a [Vec<Keypoint>]>,
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
            is_fixed: Vec::new(),
            directions: Vec::new(),
            center,
            heights,
            height_prior: None,
        };
        for (i, view) in scene.views.iter().enumerate() {
            if left_out.iter().any(|l| l.0 == view.name) {
                continue;
            }
            let of_view = keypoints.map(|all| all[i].as_slice());
            let found = of_view.map_or(MIN_KEYPOINTS, <[Keypoint]>::len);
            match view.direction_deg(middle) {
                _ if found < MIN_KEYPOINTS => {
                    left_out.push((
                        view.name.clone(),
                        format!("{found} keypoints: is the image constant or empty?"),
                    ));
                }
                None => left_out
                    .push((view.name.clone(), "its RPC cannot be localised at the scene's heights".into())),
                Some(direction) => {
                    if let Some(first) = of_view.and_then(|own| same_pixels(own, &views)) {
                        left_out.push((view.name.clone(), format!("its pixels are those of `{first}`")));
                        continue;
                    }
                    tracing::debug!("{}: {} keypoints", view.name, of_view.map_or(0, <[Keypoint]>::len));
                    network.rpcs.push(&view.rpc);
                    network.frames.push(ImageFrame::new((view.width, view.height)));
                    network.is_fixed.push(false);
                    network.directions.push(direction);
                    views.push(UsedView { view, keypoints: of_view.unwrap_or_default() });
                }
            }
        }
        left_out[known..].iter().for_each(|view| warn_left_out(progress, view));
        if views.len() < 2 {
            return Err(too_few(views.len(), scene.views.len(), &left_out));
        }
        let pairs = if keypoints.is_some() { overlapping_pairs(&views, &network)? } else { Vec::new() };
        Ok(Self { views, network, pairs, control: Vec::new(), left_out, progress })
    }

    /// Takes over what defines the datum: reference views, an elevation model, ground control.
    ///
    /// # Errors
    /// [`BundleError::Reference`], [`BundleError::ControlImage`].
    pub(super) fn set_datum(&mut self, scene: &Scene, options: &'a BundleOptions) -> Result<(), BundleError> {
        self.fix_views(&options.reference)?;
        self.network.height_prior = options.height_prior.as_ref();
        let names: Vec<&str> = self.views.iter().map(|v| v.view.name.as_str()).collect();
        self.control = tracks_of(&options.control, scene, &names, &self.network.block())?;
        Ok(())
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

    /// The error that says which views tracks join.
    pub(super) fn not_connected(&self, groups: &[Vec<usize>]) -> BundleError {
        let list = |g: &Vec<usize>| {
            let names: Vec<&str> = g.iter().map(|v| self.views[*v].view.name.as_str()).collect();
            format!("{{{}}}", names.join(", "))
        };
        let components = groups.iter().map(list).collect::<Vec<_>>().join(" | ");
        BundleError::NotConnected { components, hint: height_hint(self.network.heights) }
    }

    /// The error that no match agrees with the cameras.
    pub(super) fn no_tracks(&self) -> BundleError {
        let of_heights = height_hint(self.network.heights);
        let hint = match self.control.len() {
            0 => format!("do the RPCs belong to the images? {of_heights}"),
            n => format!(
                "the cameras follow {n} ground control points: are these of this place and in its height system? without them, do \
                 the RPCs belong to the images? {of_heights}"
            ),
        };
        BundleError::NoTracks { hint }
    }

    /// The views outside of the first and largest group that tracks join.
    pub(super) fn apart(&self, groups: &[Vec<usize>]) -> Vec<LeftOut> {
        let reason =
            "no match connects it with the other views: is its image turned, negative or of another place?";
        let apart = groups.iter().skip(1).flatten();
        apart.map(|v| (self.views[*v].view.name.clone(), reason.to_owned())).collect()
    }

    /// Narrows the range of heights to that of the points, outliers excepted, with a margin.
    pub(super) fn narrow_heights(&mut self, estimate: &Estimate) {
        let mut z: Vec<f64> = estimate.points.iter().map(|p| p[2] + self.network.center.height_m()).collect();
        z.sort_by(f64::total_cmp);
        let at = |share: f64| z[(share * (z.len() - 1) as f64) as usize];
        let (low, high) = self.network.heights;
        self.network.heights = (
            (at(0.005) - HEIGHT_MARGIN_M).max(low - HEIGHT_MARGIN_M),
            (at(0.995) + HEIGHT_MARGIN_M).min(high + HEIGHT_MARGIN_M),
        );
    }

    /// Ground sampling distance, the mean of all views, metres.
    pub(super) fn gsd_m(&self) -> f64 {
        let height_m = self.network.center.height_m();
        let of_views = self.views.iter().filter_map(|v| v.view.gsd_m(height_m));
        let (sum, n) = of_views.fold((0.0, 0.0), |(sum, n), (a, b)| (sum + (a * b).sqrt(), n + 1.0));
        sum / n
    }

    /// The corrected cameras of all views.
    ///
    /// # Errors
    /// [`BundleError::Refit`].
    pub(super) fn corrected(&self, corrections: &[Parameters]) -> Result<Vec<Rpc>, BundleError> {
        let (network, views) = (&self.network, &self.views);
        let heights = (network.heights.0 - REFIT_MARGIN_M, network.heights.1 + REFIT_MARGIN_M);
        let camera = |(v, p): (usize, &Parameters)| {
            let corrected = network.frames[v].corrected(network.rpcs[v], p, heights);
            corrected.map_err(|reason| BundleError::Refit { view: views[v].view.name.clone(), reason })
        };
        corrections.par_iter().enumerate().map(camera).collect()
    }

    /// Number of tie-point observations of each view.
    pub(super) fn observation_counts(&self, tracks: &[Track]) -> Vec<usize> {
        let mut counts = vec![0; self.views.len()];
        for seen in tracks.iter().filter(|t| t.prior.is_none()).flat_map(|t| &t.observations) {
            counts[seen.view] += 1;
        }
        counts
    }
}

/// Whether the first of some groups has two thirds of the views or more, so that the others are the odd ones. Of views whose images
/// are exchanged in a circle some agree by chance: three of five.
pub(super) fn has_majority(groups: &[Vec<usize>]) -> bool {
    let others: usize = groups.iter().skip(1).map(Vec::len).sum();
    groups.first().is_some_and(|first| first.len() >= 2 * others.max(1))
}

/// Result of one attempt.
pub(super) enum Outcome {
    Adjusted(Estimate),
    /// These views contradict the others or are not connected with them; another attempt is made without them.
    Rejected(Vec<LeftOut>),
}

/// Makes attempts, each without the views that those before rejected, until one rejects none.
///
/// # Errors
/// Those of `start` and `run`.
pub(super) fn attempt<'a>(
    start: impl Fn(Vec<LeftOut>) -> Result<Adjuster<'a>, BundleError>,
    run: impl Fn(&mut Adjuster<'a>) -> Result<Outcome, BundleError>,
) -> Result<(Adjuster<'a>, Estimate), BundleError> {
    let mut left_out = Vec::new();
    loop {
        let mut adjuster = start(left_out)?;
        match run(&mut adjuster)? {
            Outcome::Adjusted(estimate) => return Ok((adjuster, estimate)),
            Outcome::Rejected(rejected) => {
                rejected.iter().for_each(|view| warn_left_out(adjuster.progress, view));
                left_out = adjuster.left_out;
                left_out.extend(rejected);
            }
        }
    }
}

/// Warns that a view is left out.
pub(super) fn warn_left_out(progress: &dyn Progress, (view, reason): &LeftOut) {
    progress.event(Event::Warning(format!("view `{view}` is left out: {reason}")));
}

/// The view whose keypoints are all the same as these, if there is one: a copy of an image in another file, with metadata or an RPC of its
/// own, shows nothing new, and agrees with itself perfectly.
fn same_pixels<'a>(keypoints: &[Keypoint], views: &[UsedView<'a>]) -> Option<&'a str> {
    let is_same = |(a, b): (&Keypoint, &Keypoint)| a.px == b.px && a.descriptor.iter().eq(&b.descriptor);
    let is_copy = |view: &&UsedView| {
        view.keypoints.len() == keypoints.len() && view.keypoints.iter().zip(keypoints).all(is_same)
    };
    views.iter().find(is_copy).map(|used| used.view.name.as_str())
}

fn too_few(usable: usize, all: usize, left_out: &[LeftOut]) -> BundleError {
    let list: Vec<String> = left_out.iter().map(|(n, r)| format!("{n} ({r})")).collect();
    BundleError::TooFewViews { usable, all, left_out: list.join(", ") }
}
