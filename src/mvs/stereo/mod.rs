//! Stereo matching in the images, for two to five views.
//!
//! With few views, the plane sweep over the map grid is unreliable: one pixel may explain several cells, and
//! false surfaces may occlude the ground from the only pair that sees it. Here each pixel of a view has
//! exactly one altitude.
//!
//! 1. Each view in turn is the reference view, its partners in the stereo pairs are the source views
//!    (`reference`). A cost volume is computed along the rays of its pixels (`rays`): normalised
//!    cross-correlation in windows of three sizes (`ray_costs`).
//! 2. Semi-global matching (Hirschmüller 2008, §2.3) gives an altitude map of the reference view. The penalty
//!    P2 is lower at strong edges of the image (`altitude_map`).
//! 3. The consistency check keeps altitudes that the map of a source view confirms (§2.6 there, for any
//!    number of views); small connected parts are removed (`consistency`).
//! 4. The maps are resampled to the map grid as meshes. Each cell takes the median over the views (`fuse`).
//!    Cells that no two maps agree on are filled from their surroundings, with a score of 0 (`fill`).

mod altitude_map;
mod consistency;
mod fill;
mod fuse;
mod ray_costs;
mod rays;
mod reference;

use super::image::MatchImage;
use super::plane_sweep::{MAX_VOLUME, PlaneSweep};
use super::surface::MatchedSurface;
use crate::io::{Grid2, Window};
use crate::progress::{Event, Interrupted, Progress};
use altitude_map::AltitudeMap;
use ray_costs::RayCosts;
use rays::Rays;
use reference::{ReferenceView, reference_views};

/// Number of views up to which they are matched in the images instead of on the map grid.
pub const FEW_VIEWS: usize = 5;
/// Distance between planes, pixels of the source view in which it is largest.
const PLANE_STEP_PX: f64 = 0.5;
/// Rows above and below a strip that are matched with it, so that the paths of semi-global matching have
/// settled where the strip begins.
const STRIP_MARGIN: usize = 64;

/// Matches the images of a few views.
pub(super) fn match_views(
    sweep: &PlaneSweep,
    progress: &dyn Progress,
) -> Result<MatchedSurface, Interrupted> {
    progress.event(Event::Started { stage: "matching the surface", total: sweep.images.len() as u64 });
    let references = reference_views(sweep);
    let mut maps = Vec::with_capacity(references.len());
    for (done, reference) in (1..).zip(&references) {
        progress.check()?;
        maps.push(altitude_map(sweep, reference, strip_rows(sweep, reference)));
        progress.event(Event::Advanced { done, status: String::new() });
    }
    let consistent = consistency::consistent(&sweep.images, &maps, &references);
    let surface = fuse::fused(sweep, &references, &consistent);
    progress.event(Event::Finished);
    Ok(surface)
}

/// Number of rows of a view that are matched at a time, so that their cost volume fits into [`MAX_VOLUME`].
fn strip_rows(sweep: &PlaneSweep, reference: &ReferenceView) -> usize {
    let planes = (sweep.stack.height_m() / (PLANE_STEP_PX * reference.metres_per_px)).ceil() + 1.0;
    let rows = MAX_VOLUME / (sweep.images[reference.view].gray.width as f64 * planes);
    (rows as usize).saturating_sub(2 * STRIP_MARGIN).max(STRIP_MARGIN)
}

/// The altitude map of one view, matched in strips of `rows` rows.
fn altitude_map(sweep: &PlaneSweep, reference: &ReferenceView, rows: usize) -> AltitudeMap {
    let image = &sweep.images[reference.view];
    let sources: Vec<&MatchImage> = reference.sources.iter().map(|j| &sweep.images[*j]).collect();
    let step_m = PLANE_STEP_PX * reference.metres_per_px;
    let Grid2 { width, height, .. } = image.gray;
    let mut map = AltitudeMap::unknown(width, height);
    for first in (0..height).step_by(rows) {
        let last = (first + rows).min(height);
        let (from, to) = (first.saturating_sub(STRIP_MARGIN), (last + STRIP_MARGIN).min(height));
        let strip = image.cropped(Window { col: 0, row: from, width, height: to - from });
        let rays = Rays::new(sweep, &strip, &sources, step_m);
        let costs = RayCosts::new(&strip, &sources, &rays);
        map.copy_rows(first..last, &AltitudeMap::optimized(&strip, &rays, &costs), from);
    }
    map
}

#[cfg(test)]
mod tests;
