//! Priors: what a network, a sensor or a surface says of the depths and normals that views see, before any training.

mod map;

pub use map::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
