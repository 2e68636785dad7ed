//! Training of perspective scenes: photographs with pinhole cameras, and splats whose colour depends on the direction of view
//! (Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023).
//!
//! An iteration renders one view and compares it with its image, both as displayed: there is no sun, and no colour model.
//! Schedule, optimiser, densification and checkpoints are those of satellite scenes. Training takes place in a frame of its own
//! ([`WorkingFrame`]), so that its lengths do not depend on the unit of the scene.

#[cfg(test)]
mod indoor_tests;
mod objective;
mod picture;
mod seen;
mod start;
mod view;
mod views;
mod working_frame;

pub use objective::{
    AnyPinholeObjective, DiscObjective, EllipsoidObjective, PinholeObjective, PinholeStep, objective,
};
pub use picture::{DiscPlanes, PinholePicture, comparison};
pub use seen::{ellipsoid_reach, least_logit, least_reach_px};
pub use start::{focus, splats_at_points, splats_on_rays};
pub use view::{PinholeView, extent_m};
pub use views::PinholeViews;
pub use working_frame::{NEAREST, WorkingFrame};
