//! Affine cameras in the site frame, fitted to RPCs, and the training scene made of them.
//!
//! The cameras of the sun and of virtual views are sheared view cameras: a point at altitude `z` (metres
//! above the site's origin) moves by `-shear * z` pixels in the image, and points at the altitude of the
//! origin stay. The third image coordinate, by which splats are ordered, is the altitude for all of these
//! cameras.

mod approximation;
mod camera;
mod fit;
mod site_scene;
mod training_view;

pub use approximation::{GroundBox, Order, Residual, residual};
pub use camera::{ViewCamera, sun_direction};
pub use fit::{AffineFit, FitError, fit};
pub use site_scene::{SiteScene, SiteSceneError, SiteView, height_range};
pub use training_view::{TrainingView, median_pixel_m};
