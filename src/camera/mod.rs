//! What the rasteriser asks of a camera: the kernel trait, and the kernels of parallel projections.
//!
//! A new camera is a type that implements [`CameraKernel`], in a file of its own: `perspective::PinholeKernel` is an
//! example. The rasteriser is compiled for it.

mod kernel;
mod parallel;

pub use kernel::{CameraKernel, DepthOrder, Linearized};
pub use parallel::{AffineKernel, QuadraticKernel};
