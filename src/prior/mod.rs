//! Priors: what a network, a sensor or a surface says of the depths and normals that views see, before any training.
//!
//! [`PriorFolder`] reads maps from files. [`read_priors`] reads those of all views, and compares them with the points of the scene:
//! what contradicts them is refused. [`dense_start`] adds points to start from where the scene has few.

mod agreement;
mod dense;
mod error;
mod fit;
mod folder;
mod map;
mod of_views;
mod seen;

pub use dense::{DenseSummary, DenseView, dense_start};
pub use error::PriorError;
pub use folder::{PriorDescription, PriorFolder};
pub use map::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
pub use of_views::{PriorSources, read_priors};

#[cfg(test)]
mod tests;
