//! Reference views, and the source views that each is matched with.

use super::rays::metres_per_pixel;
use crate::mvs::plane_sweep::PlaneSweep;

/// Smallest difference of altitude between neighbouring pixels that counts as a discontinuity: this many
/// cells of the map grid (a slope of about 70°), or this many pixels' worth of altitude (which exceeds the
/// noise), whichever is more.
const DISCONTINUITY_CELLS: f64 = 3.0;
const DISCONTINUITY_PX: f64 = 0.7;

/// A view whose pixels get altitudes.
pub(super) struct ReferenceView {
    /// Index of the view.
    pub view: usize,
    /// Indices of the views that it is matched with.
    pub sources: Vec<usize>,
    /// Difference of altitude that moves a point by one pixel, in the source view where it moves farthest, metres.
    pub metres_per_px: f64,
    /// Difference of altitude between neighbouring pixels above which they lie on two surfaces, metres.
    pub discontinuity_m: f32,
}

/// The views that are part of a stereo pair.
pub(super) fn reference_views(sweep: &PlaneSweep) -> Vec<ReferenceView> {
    let is_pair = |i: usize, j: usize| sweep.pairs.contains(&(i.min(j), i.max(j)));
    let of = |view: usize| {
        let sources: Vec<usize> =
            (0..sweep.images.len()).filter(|j| *j != view && is_pair(view, *j)).collect();
        let camera = &sweep.images[view].camera;
        let all = sources.iter().map(|j| metres_per_pixel(camera, &sweep.images[*j].camera));
        let metres_per_px = all.reduce(f64::min)?;
        let discontinuity_m =
            (DISCONTINUITY_CELLS * sweep.grid.cell).max(DISCONTINUITY_PX * metres_per_px) as f32;
        Some(ReferenceView { view, sources, metres_per_px, discontinuity_m })
    };
    (0..sweep.images.len()).filter_map(of).collect()
}
