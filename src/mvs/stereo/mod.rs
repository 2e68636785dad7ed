//! Stereo matching in the images, for two to five views.
//!
//! With few views, the plane sweep over the map grid is unreliable: one pixel may explain several cells, and
//! false surfaces may occlude the ground from the only pair that sees it. Here each pixel of a view has
//! exactly one altitude.
//!
//! 1. Each view in turn is the reference view, its partners in the stereo pairs are the source views
//!    (`reference`). A cost volume is computed along the rays of its pixels (`rays`): normalised
//!    cross-correlation in windows of three sizes (`super::ray_costs`).
//! 2. Semi-global matching (Hirschmüller 2008, §2.3) gives an altitude map of the reference view. The penalty
//!    P2 is lower at strong edges of the image (`super::ray_map`).
//! 3. The consistency check keeps altitudes that the map of a source view confirms (§2.6 there, for any
//!    number of views); small connected parts are removed (`super::consistency`).
//! 4. The maps are resampled to the map grid as meshes. Each cell takes the median over the views (`fuse`).
//!    Cells that no two maps agree on are filled from their surroundings, with a score of 0 (`fill`): low beside steps, smoothly
//!    on terrain without steps (`steps`).

mod fill;
mod fuse;
mod ray_ranges;
mod rays;
mod reference;
mod steps;

use super::consistency::{Check, consistent};
use super::image::MatchImage;
use super::pairs::MatchError;
use super::plane_sweep::{MAX_VOLUME, PlaneSweep};
use super::ray_map::RayMap;
use super::reference_view::ReferenceView;
use super::surface::MatchedSurface;
use crate::checkpoint::PartStore;
use crate::progress::{Event, Progress};
use ray_ranges::RayRanges;
use rays::GroundRays;
use reference::reference_views;

/// Number of views up to which they are matched in the images instead of on the map grid.
pub const FEW_VIEWS: usize = 5;
/// Distance between planes, pixels of the source view in which it is largest.
const PLANE_STEP_PX: f64 = 0.5;
/// How altitudes are checked: a pair has one source view.
const CHECK: Check = Check { confirmations: 1, least_part_px: 40 };

/// Matches the images of a few views; see [`PlaneSweep::run`].
pub(super) fn match_views(
    sweep: &PlaneSweep,
    parts: Option<&PartStore>,
    progress: &dyn Progress,
) -> Result<MatchedSurface, MatchError> {
    progress.event(Event::Started { stage: "matching the surface", total: sweep.images.len() as u64 });
    let references = reference_views(sweep);
    let mut maps = Vec::with_capacity(references.len());
    for (done, reference) in (1..).zip(&references) {
        progress.check()?;
        let map = || Ok::<_, MatchError>(altitude_map(sweep, reference, MAX_VOLUME));
        maps.push(PartStore::part(parts, &format!("view_{}", reference.view), "", map)?);
        progress.event(Event::Advanced { done, status: String::new() });
    }
    if let Some(parts) = parts {
        parts.tell(progress);
    }
    let maps = consistent(&sweep.images, &maps, &references, CHECK);
    let surface = fuse::fused(sweep, &references, &maps);
    progress.event(Event::Finished);
    Ok(surface)
}

/// The altitude map of one view, matched in strips whose cost volumes have at most `most` entries.
fn altitude_map(sweep: &PlaneSweep, reference: &ReferenceView, most: f64) -> RayMap {
    let image = &sweep.images[reference.view];
    let sources: Vec<&MatchImage> = reference.sources.iter().map(|j| &sweep.images[*j]).collect();
    let step_m = PLANE_STEP_PX * reference.value_per_px;
    let RayRanges { low_m, blocks } = RayRanges::new(sweep, image, step_m);
    let mut map = RayMap::matched(image, &sources, &blocks, most, |strip, ranges| {
        GroundRays::new(sweep, strip, &sources, (low_m, step_m), ranges)
    });
    if let Some(candidates) = &sweep.candidates {
        map.keep(|pixel, altitude| candidates.at(image.point(pixel, altitude)).contains(f64::from(altitude)));
    }
    map
}

#[cfg(test)]
mod tests;
