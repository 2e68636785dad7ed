//! The Gaussians, their rendering and their training.

pub mod adam;
pub mod appearance;
pub mod backend;
pub mod checkpoint;
pub mod cpu;
pub mod density;
pub mod gaussians;
pub mod hold;
pub mod init;
pub mod lanes;
pub mod lookup;
pub mod novel;
pub mod objective;
pub mod picture_score;
pub mod ply;
pub mod progress;
pub mod random;
pub mod raster;
pub mod real;
pub mod recipe;
pub mod setup;
pub mod ssim;
pub mod stopwatch;
pub mod sweep;
pub mod train;
pub mod views;
