//! Splats (3-D Gaussians, as in 3DGS), their rendering and their training.
//!
//! Positions are in the site frame: metres east, north and up from the site's origin. A name `by_x` holds derivatives of the
//! loss with respect to `x`. The *picture* of a view is its render after shadows and colour model, which is compared with
//! the view's image, the *target*.

pub mod adam;
pub mod anchored;
pub mod appearance;
pub mod backend;
pub mod densify;
#[cfg(test)]
mod differences;
pub mod edit;
#[cfg(feature = "gpu")]
#[cfg_attr(docsrs, doc(cfg(feature = "gpu")))]
pub mod gpu;
pub mod growth;
pub mod harmonics;
pub mod harmonics_turn;
pub mod image_score;
pub mod init;
pub mod loss;
pub mod pinhole;
pub mod ply;
pub mod primitive;
pub mod raster;
pub mod recipe;
pub mod satellite;
pub mod seen_gradient;
pub mod shadow;
pub mod shear_warp;
pub mod sheared_camera;
pub mod splats;
pub mod state;
pub mod stopwatch;
pub mod sun_visibility;
pub mod train;
pub mod transformed;
pub mod trial;
pub mod visibility;
