//! The Splats, their rendering and their training.

pub mod adam;
pub mod appearance;
pub mod backend;
pub mod densify;
pub mod edit;
pub mod image_score;
pub mod init;
pub mod loss;
pub mod novel_view;
pub mod objective;
pub mod ply;
pub mod raster;
pub mod shadow;
pub mod shear_warp;
pub mod splats;
pub mod state;
pub mod train;
