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
//!    Cells that no two maps agree on are filled from their surroundings, with a score of 0 (`fill`): low beside steps, smoothly
//!    on terrain without steps (`steps`).

mod altitude_map;
mod consistency;
mod fill;
mod fuse;
mod ray_costs;
mod ray_ranges;
mod rays;
mod reference;
mod steps;

use super::image::MatchImage;
use super::plane_sweep::{MAX_VOLUME, PlaneSweep};
use super::surface::MatchedSurface;
use crate::io::{Grid2, Window};
use crate::progress::{Event, Interrupted, Progress};
use altitude_map::AltitudeMap;
use ray_costs::RayCosts;
use ray_ranges::{BLOCKS, RayRanges};
use rays::Rays;
use reference::{ReferenceView, reference_views};
use std::ops::Range;

/// Number of views up to which they are matched in the images instead of on the map grid.
pub const FEW_VIEWS: usize = 5;
/// Distance between planes, pixels of the source view in which it is largest.
const PLANE_STEP_PX: f64 = 0.5;
/// Rows of blocks above and below a strip that are matched with it, so that the paths of semi-global matching have settled
/// where the strip begins: 64 rows of pixels.
const STRIP_MARGIN: usize = 64 / BLOCKS.rows;

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
        maps.push(altitude_map(sweep, reference, MAX_VOLUME));
        progress.event(Event::Advanced { done, status: String::new() });
    }
    let consistent = consistency::consistent(&sweep.images, &maps, &references);
    let surface = fuse::fused(sweep, &references, &consistent);
    progress.event(Event::Finished);
    Ok(surface)
}

/// The altitude map of one view, matched in strips whose cost volumes have at most `most` entries.
fn altitude_map(sweep: &PlaneSweep, reference: &ReferenceView, most: f64) -> AltitudeMap {
    let image = &sweep.images[reference.view];
    let sources: Vec<&MatchImage> = reference.sources.iter().map(|j| &sweep.images[*j]).collect();
    let step_m = PLANE_STEP_PX * reference.metres_per_px;
    let all = RayRanges::new(sweep, image, step_m);
    let Grid2 { width, height, .. } = image.gray;
    let mut map = AltitudeMap::unknown(width, height);
    for (own, matched) in strips(&all, most) {
        let rows = |blocks: &Range<usize>| {
            (blocks.start * BLOCKS.rows).min(height)..(blocks.end * BLOCKS.rows).min(height)
        };
        let ranges = all.of_rows(matched.clone());
        let (own, matched) = (rows(&own), rows(&matched));
        let strip = image.cropped(Window { col: 0, row: matched.start, width, height: matched.len() });
        let rays = Rays::new(sweep, &strip, &sources, (all.low_m, step_m), &ranges);
        let costs = RayCosts::new(&strip, &sources, &rays, &ranges);
        let mut found = AltitudeMap::optimized(&strip, &rays, &costs);
        if let Some(candidates) = &sweep.candidates {
            found.keep(|pixel, altitude| {
                candidates.at(strip.point(pixel, altitude)).contains(f64::from(altitude))
            });
        }
        map.copy_rows(own, &found, matched.start);
    }
    map
}

/// The rows of blocks of strips, and those that are matched with them: as many as fit into a volume of `most` entries, and at
/// least one.
fn strips(all: &RayRanges, most: f64) -> Vec<(Range<usize>, Range<usize>)> {
    let rows = all.rows();
    let with_margins =
        |own: &Range<usize>| own.start.saturating_sub(STRIP_MARGIN)..(own.end + STRIP_MARGIN).min(rows);
    let volume = |own: &Range<usize>| with_margins(own).map(|row| all.volume(row)).sum::<usize>() as f64;
    let mut out = Vec::new();
    let mut own = 0..1;
    while own.start < rows {
        while own.end < rows && volume(&(own.start..own.end + 1)) <= most {
            own.end += 1;
        }
        out.push((own.clone(), with_margins(&own)));
        own = own.end..own.end + 1;
    }
    out
}

#[cfg(test)]
mod tests;
