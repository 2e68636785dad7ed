//! Runs of perspective scenes: photographs with pinhole cameras.
//!
//! The run folder is that of satellite scenes without an adjustment. `scene.json` says where the scene lies and how it is read;
//! commands that need its images read it again.

mod cameras;
mod images;
mod manifest;
mod render;
mod prior_pictures;
mod priors;
mod reading;
mod run;
mod scene_fingerprint;
mod scores;
mod start;
mod start_pictures;
mod train;

pub use cameras::{PerspectiveCameras, TrainedPhoto};
pub(super) use images::require_own_images;
pub use manifest::PerspectiveManifest;
pub(super) use manifest::{is_run, refuse};
pub(super) use reading::tell_of_scene;
pub(super) use render::render;
pub use run::{PerspectiveRunOptions, run_perspective};
pub(super) use scene_fingerprint::scene_fingerprint;
pub(super) use scores::nvs_eval;
pub(super) use start::start_points;
pub(super) use train::{read_views, train_locked, write_trained};
