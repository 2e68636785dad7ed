//! Co-registration: the translation that brings a scene to a reference. Tie points do not determine it, and delivered
//! cameras know it to some metres only.
//!
//! To a height raster, it is the shift with the smallest mean absolute difference of heights after removal of their
//! median difference. It is found on a grid of shifts and refined by pattern search. Differences are clipped at
//! `CLIP_M`, because buildings that changed say nothing about the shift; shifts are compared on the points that have heights under
//! both. Directions in which the curvature at the minimum, or another minimum, leaves the shift open are not moved. To
//! surveyed points, it is the median of their differences.

mod control;
mod error;
mod shift;
mod surface;

pub use control::to_control;
pub use error::CoregisterError;
pub use shift::{Coregistration, Shift};
pub use surface::to_surface;
