//! Test sets of photographs: pinhole cameras in front of a surface that is known exactly.
//!
//! A [`TestSet`] writes what a perspective scene needs (images, a COLMAP model with points) and what methods are compared
//! with (exact depths, normals and mesh) or fed with (depths and normals as networks give them). Cameras and files are the
//! simulator's own: nothing is shared with the readers and cameras that are tested with these sets.

mod camera;
mod colmap;
mod frames;
mod points;
mod priors;
mod set;
mod summary;
pub(super) mod surface_mesh;

pub(super) use camera::PinholeCamera;
pub use frames::StatedCamera;
pub(super) use frames::{FRAMES, frame_files, write_frames};
pub(super) use points::PointRules;
pub(super) use set::{DESCRIPTION, DISPARITIES, IMAGES, MAPS, MESH, MODEL, TestSet};
pub use summary::{DisparityMap, TestSetSummary, TestSetView};

use glam::DVec3;

/// Where a ray first meets a surface.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    /// Distance from the start of the ray, in lengths of its direction.
    pub(super) distance: f64,
    /// Unit normal on the side from which the ray comes.
    pub(super) normal: DVec3,
    /// Whether structure from motion would find points here.
    pub(super) is_textured: bool,
}

/// What the cameras of a test set look at.
pub(super) trait Scenery: Sync {
    /// Where a ray first meets a surface.
    fn first_hit(&self, from: DVec3, along: DVec3) -> Option<Hit>;

    /// The image that a camera takes: red, green and blue of each pixel, row by row.
    fn picture(&self, camera: &PinholeCamera) -> Vec<u8>;
}
