//! The interface between cameras and the rasteriser: the kernel trait, and the kernel of parallel projections.
//!
//! A new camera model is a type that implements [`CameraKernel`], such as `perspective::PinholeKernel`. The
//! rasteriser is generic over it.

mod kernel;
mod parallel;

pub use kernel::{CameraKernel, DepthOrder, Linearized, damped_quotient, damped_quotient_gradient};
pub use parallel::QuadraticKernel;
