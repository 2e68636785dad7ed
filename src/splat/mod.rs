//! The Gaussians, their rendering and their training.

pub mod gaussians;
pub mod raster;
pub mod real;
