//! Reference views, and the source views that each is matched with.

use super::rays::metres_per_pixel;
use crate::mvs::plane_sweep::PlaneSweep;
use crate::mvs::reference_view::ReferenceView;

/// Smallest difference of altitude between neighbouring pixels that counts as a discontinuity: this many
/// cells of the map grid (a slope of about 70°), or this many pixels' worth of altitude (which exceeds the
/// noise), whichever is more.
const DISCONTINUITY_CELLS: f64 = 3.0;
const DISCONTINUITY_PX: f64 = 0.7;

/// The views that are part of a stereo pair.
pub(super) fn reference_views(sweep: &PlaneSweep) -> Vec<ReferenceView> {
    let is_pair = |i: usize, j: usize| sweep.pairs.contains(&(i.min(j), i.max(j)));
    let of = |view: usize| {
        let sources: Vec<usize> =
            (0..sweep.images.len()).filter(|j| *j != view && is_pair(view, *j)).collect();
        let camera = &sweep.images[view].camera;
        let all = sources.iter().map(|j| metres_per_pixel(camera, &sweep.images[*j].camera));
        let value_per_px = all.reduce(f64::min)?;
        let discontinuity =
            (DISCONTINUITY_CELLS * sweep.grid.cell).max(DISCONTINUITY_PX * value_per_px) as f32;
        Some(ReferenceView { view, sources, value_per_px, discontinuity })
    };
    (0..sweep.images.len()).filter_map(of).collect()
}
