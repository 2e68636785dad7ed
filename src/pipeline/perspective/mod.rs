//! Runs of perspective scenes: photographs with pinhole cameras.
//!
//! The run folder is that of satellite scenes without an adjustment. `scene.json` says where the scene lies and how it is read;
//! commands that need its images read it again.

mod device;
mod render;
mod prior_pictures;
mod priors;
mod scores;
mod start;
mod start_pictures;
mod train;

pub(super) use render::render;
pub(super) use scores::nvs_eval;
pub(super) use train::train_locked;
pub(crate) use train::train_scene;
