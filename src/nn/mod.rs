//! Small neural networks: layers with gradients derived by hand, hash grids, their optimiser, and networks of others that
//! are read from files.
//!
//! Everything is generic over the number type: training runs in `f32`, and tests compare gradients with central differences
//! in `f64`. Sums are taken over fixed blocks in fixed order, so that results do not depend on the number of threads.

pub mod adam;
mod convolution;
mod feature_map;
pub mod features;
pub mod hash_grid;
pub mod linear;
pub mod lpips;
mod max_pool;
pub mod mlp;
pub mod onnx;
pub mod tensors;
pub mod uncertainty;
