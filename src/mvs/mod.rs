//! Dense matching of the training views: the surface that training starts from, and its refinement afterwards.
//!
//! First a sweep at low resolution over all heights that are searched finds where the surface may lie, place by place
//! (`coarse`); only there are the views matched at full resolution.
//!
//! Two matchers produce a [`MatchedSurface`], altitudes on a map grid:
//! - With more than [`FEW_VIEWS`] views, a plane sweep over the map grid (Collins 1996; Gallup et al. 2007).
//!   Each cell tests the altitudes of a stack of surfaces parallel to the ground ([`PlaneSweep`]). The views
//!   are sampled where they see the cell at that altitude, and compared pair by pair with normalised
//!   cross-correlation (`correlation`). Semi-global matching (`semiglobal`, Hirschmüller 2008) picks
//!   altitudes that agree with those of the neighbouring cells. A second pass uses the surface of the first
//!   to leave out views from which a cell is occluded (`visibility`).
//! - With few views, stereo matching in the images (`stereo`).
//!
//! [`match_photographs`] gives depth maps of photographs by the same means.
//!
//! After training, [`PlaneSweep::refine`] matches again with the altitudes of the trained splats as a prior.
//!
//! Altitudes are metres above the origin of the site. Gray values are square roots of linear radiance.

mod block_ranges;
mod candidates;
mod coarse;
mod consistency;
mod correlation;
mod coverage;
mod ground;
mod image;
mod margin;
mod matching;
mod occlusion;
mod pairs;
mod plane_ranges;
mod plane_sweep;
mod planes;
mod photographs;
mod postfilter;
mod preparation;
mod ray_costs;
mod ray_map;
mod reference_view;
mod semiglobal;
mod stereo;
mod surface;
mod visibility;

pub use ground::{Ground, ground_plane};
pub use occlusion::{OCCLUSION_TOLERANCE_M, occlusion_height};
pub use pairs::{MatchError, angle_warning};
pub use photographs::{MatchedPoint, Photograph, match_photographs, matched_points};
pub use plane_sweep::{DSM_CELL_M, MAX_VOLUME, PlaneSweep, cell_m};
pub use stereo::FEW_VIEWS;
pub use surface::MatchedSurface;

#[cfg(test)]
mod tests;
