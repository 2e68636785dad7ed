//! Training of satellite scenes (EOGS): parallel rays, a sun, and images of many dates.
//!
//! An iteration renders one view, the image from its sun and a virtual view beside it. The view's colour model computes the
//! picture, which is compared with the image in linear colours.

mod novel_view;
mod objective;
mod step_cameras;
mod test_time;
mod views;

pub use novel_view::{NovelView, Picture};
pub use objective::{Gradient, SatelliteObjective, SatelliteStep};
pub use step_cameras::StepCameras;
pub use test_time::fit_view;
pub use views::{SatelliteScene, SatelliteViews};
