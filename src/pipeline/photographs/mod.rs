//! Photographs before a training or a prediction: their pixels, and whether they fit to the cameras and points of the scene.

mod checks;
mod own_images;
mod views;

pub(super) use checks::check_poses;
pub(crate) use checks::tell_of_scene;
pub(super) use own_images::require_own_images;
pub(super) use views::{read_view, read_views};
