//! The Gaussians, their rendering and their training.

pub mod appearance;
pub mod gaussians;
pub mod lookup;
pub mod objective;
pub mod random;
pub mod raster;
pub mod real;
pub mod ssim;
