//! Perspective cameras: the pinhole camera, its kernel for the rasteriser, and the removal of lens distortion.

mod distortion;
mod kernel;
mod pinhole;

pub use distortion::{Distortion, DistortionError};
pub use kernel::PinholeKernel;
pub use pinhole::PinholeCamera;
