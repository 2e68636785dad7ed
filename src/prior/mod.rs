//! Priors: what a network, a sensor or a surface says of the depths and normals that views see, before any training.
//!
//! [`PriorFolder`] reads maps from files. [`read_priors`] reads those of all views, and compares them with the points of the scene:
//! what contradicts them is refused. [`dense_start`] adds points to start from where the scene has few; [`aligned_start`] puts one behind each pixel.

mod agreement;
mod aligned_start;
mod dense;
mod error;
mod fit;
mod folder;
mod hdd;
mod map;
mod of_views;
mod pseudo_views;
mod seen;

pub use aligned_start::{AlignedDepth, AlignedStart, PixelColor, StartView, UnseenPixels, aligned_start};
pub use dense::{DenseSummary, DenseView, dense_start};
pub use error::PriorError;
pub use folder::{PriorDescription, PriorFolder};
pub use hdd::{AlignmentQuality, FEWEST_POINTS};
pub use map::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
pub use of_views::{PriorSources, read_priors};
pub use pseudo_views::PseudoView;

#[cfg(test)]
mod tests;
