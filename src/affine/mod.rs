//! Affine cameras in the site frame: fitted to RPCs, and sheared into sun and virtual cameras.
//!
//! Every camera of an iteration is a shear of one view camera along the vertical: a point at altitude `z` (metres
//! above the site's origin) moves by `-shear * z` pixels. The site's origin is the pivot. Third image coordinate
//! is the altitude itself, whatever the camera.

mod approximation;
mod camera;
mod fit;
mod site_scene;
mod training_view;

pub use approximation::{GroundBox, Order, Residual, residual};
pub use camera::{AffineCamera, sun_direction};
pub use fit::{AffineFit, FitError, fit};
pub use site_scene::{SiteScene, SiteSceneError, SiteView, height_range};
pub use training_view::{TrainingView, median_pixel_m};
