//! Cameras of views in the site frame, fitted to RPCs, and the training scene made of them. They are affine with a small
//! quadratic term.
//!
//! The cameras of the sun and of virtual views are sheared view cameras: a point at altitude `z` (metres
//! above the site's origin) moves by `-shear * z` pixels in the image, and points at the altitude of the
//! origin stay. The third image coordinate, by which splats are ordered, is the altitude for all of these
//! cameras.

mod approximation;
mod camera;
mod fit;
mod site_frame;
mod site_scene;
mod training_view;

pub use approximation::{GroundBox, Residual, residual};
pub use camera::{ViewCamera, sun_direction};
pub use fit::{CameraFit, FitError, Order, fit};
pub use site_frame::SiteFrame;
pub use site_scene::{MIN_POINTS, SiteScene, SiteSceneError, SiteView, with_margins};
pub use training_view::{TrainingView, median_pixel_m};
