//! Tie points measured again by least-squares matching in all views, instead of by keypoints in a few.

use super::adjuster::Adjuster;
use super::correction::CorrectionModel;
use super::duplicates::merge_duplicates;
use super::error::BundleError;
use super::network::{Estimate, LOSS_SCALES_PX};
use super::patches::{ImagePatch, LsmMatcher, ground_tiles};
use super::problem::Observation;
use crate::io::RasterError;
use crate::progress::Event;
use rayon::prelude::*;

/// A point is confirmed when so many views show its patch, or half of all views if these are fewer, but two at least.
const MIN_VIEWS: usize = 4;
/// Weight of the keypoints of points that are not confirmed: they determine a view that has no other observations, and
/// are negligible for all other views.
const UNCONFIRMED_WEIGHT: f64 = 0.01;
/// Observations with residuals below this are never rejected, pixels.
pub(super) const MIN_PATCH_LIMIT_PX: f64 = 0.4;
/// Points whose height has a larger standard deviation are dropped, in ground sampling distances.
const MAX_HEIGHT_SIGMA_PX: f64 = 10.0;
/// Side of the tiles of ground whose points are measured at a time, pixels.
const TILE_PX: f64 = 2048.0;

impl Adjuster<'_> {
    /// Measures every track again by least-squares matching in all views, and adjusts to these observations; tracks that
    /// the matching does not confirm keep their keypoints with the weight [`UNCONFIRMED_WEIGHT`]. Tracks that turn out to be
    /// of the same point are merged.
    pub(super) fn refine_tie_points(
        &self,
        estimate: &mut Estimate,
        model: CorrectionModel,
    ) -> Result<(), BundleError> {
        let tied = (0..estimate.tracks.len()).filter(|i| estimate.tracks[*i].prior.is_none()).collect();
        let tiles = ground_tiles(&estimate.points, tied, TILE_PX * self.gsd_m());
        self.progress.event(Event::Started { stage: "measuring patches", total: tiles.len() as u64 });
        let block = self.network.block();
        let fewest = MIN_VIEWS.min(self.views.len().div_ceil(2)).max(2);
        let images = self.views.par_iter().map(|v| Ok((v.view.gray_image()?, v.size())));
        let mut images = images.collect::<Result<Vec<_>, RasterError>>()?;
        for (done, tile) in tiles.iter().enumerate() {
            self.progress.check()?;
            let at = |i: &usize| estimate.points[*i];
            let patches = images.par_iter_mut().enumerate().map(|(v, (image, size))| {
                let shown = tile.iter().map(|i| block.project(v, &estimate.corrections[v], at(i)));
                ImagePatch::around(shown, *size, |window| image.read_without_specks(window))
            });
            let patches = patches.collect::<Result<Vec<ImagePatch>, RasterError>>()?;
            let matcher = LsmMatcher::new(&block, &estimate.corrections, patches);
            let seek = |i: &usize| matcher.track(&estimate.tracks[*i].observations[0], at(i));
            let found: Vec<Vec<Observation>> = tile.par_iter().with_min_len(16).map(seek).collect();
            for (i, found) in tile.iter().zip(found) {
                let track = &mut estimate.tracks[*i];
                if found.len() >= fewest {
                    track.observations = found;
                } else {
                    track.observations.iter_mut().for_each(|m| m.weight = UNCONFIRMED_WEIGHT);
                }
            }
            self.progress.event(Event::Advanced { done: done as u64 + 1, status: String::new() });
        }
        let confirmed = estimate
            .tracks
            .iter()
            .filter(|t| t.prior.is_none() && t.observations[0].weight > UNCONFIRMED_WEIGHT);
        tracing::debug!("patches confirm {} of {} tracks", confirmed.count(), estimate.tracks.len());
        let kept = merge_duplicates(&mut estimate.tracks);
        tracing::debug!(
            "{} tracks are of points that others observe too",
            estimate.points.len() - kept.len()
        );
        estimate.points = kept.iter().map(|i| estimate.points[*i]).collect();
        self.network.refine(estimate, &LOSS_SCALES_PX[1..], model, MIN_PATCH_LIMIT_PX)?;
        self.drop_ill_conditioned(estimate, model);
        self.progress.event(Event::Finished);
        Ok(())
    }

    /// Drops points whose height is ill-conditioned: they stem from unconfirmed keypoints with narrow angles between the
    /// rays.
    fn drop_ill_conditioned(&self, estimate: &mut Estimate, model: CorrectionModel) {
        let Some(precision) = self.network.precision(estimate, model, true) else { return };
        let most_m = MAX_HEIGHT_SIGMA_PX * self.gsd_m();
        let all = std::mem::take(&mut estimate.tracks).into_iter().zip(std::mem::take(&mut estimate.points));
        let clear =
            all.zip(precision.points).filter(|((t, _), sigma)| t.prior.is_some() || sigma[2] <= most_m);
        (estimate.tracks, estimate.points) = clear.map(|(track, _)| track).unzip();
    }
}
