//! Small neural networks: layers with gradients derived by hand, hash grids, their optimiser, and networks of others that
//! are read from files.
//!
//! Everything is generic over the number type: training runs in `f32`, and tests compare gradients with central differences
//! in `f64`. Sums are taken over fixed blocks in fixed order, so that results do not depend on the number of threads.

mod convolution;
mod feature_map;
mod lpips;
mod max_pool;

pub use lpips::{Backbone, Lpips, LpipsError, PlanarRgb};
