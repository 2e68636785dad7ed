//! The views of an adjustment, their delivered cameras, and the pairs of them that are matched.

use super::correction::{ImageFrame, Parameters};
use super::error::BundleError;
use super::features::Keypoint;
use super::network::Network;
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
    /// localised at the scene's heights; the latter two are added to `left_out`.
    pub(super) fn new(
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
            is_fixed: Vec::new(),
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
                _ if found < MIN_KEYPOINTS => {
                    left_out.push((
                        view.name.clone(),
                        format!("{found} keypoints: is the image constant or empty?"),
                    ));
                }
                None => left_out
                    .push((view.name.clone(), "its RPC cannot be localised at the scene's heights".into())),
                Some(direction) => {
                    tracing::debug!("{}: {found} keypoints", view.name);
                    network.rpcs.push(&view.rpc);
                    network.frames.push(ImageFrame::new((view.width, view.height)));
                    network.is_fixed.push(false);
                    network.directions.push(direction);
                    views.push(UsedView { view, keypoints });
                }
            }
        }
        left_out[known..].iter().for_each(|view| warn_left_out(progress, view));
        if views.len() < 2 {
            return Err(too_few(views.len(), scene.views.len(), &left_out));
        }
        let pairs = overlapping_pairs(&views, &network)?;
        Ok(Self { views, network, pairs, control: Vec::new(), left_out, progress })
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

/// Warns that a view is left out.
pub(super) fn warn_left_out(progress: &dyn Progress, (view, reason): &LeftOut) {
    progress.event(Event::Warning(format!("view `{view}` is left out: {reason}")));
}

fn too_few(usable: usize, all: usize, left_out: &[LeftOut]) -> BundleError {
    let list: Vec<String> = left_out.iter().map(|(n, r)| format!("{n} ({r})")).collect();
    BundleError::TooFewViews { usable, all, left_out: list.join(", ") }
}
