//! What the simulation of a test set of photographs reports.

pub use super::priors::DisparityMap;
use crate::scene::Role;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// One image of a test set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TestSetView {
    /// File name of the image without extension.
    pub name: String,
    /// Whether the lists of the set hold it back; without lists, all images are to be trained on.
    pub role: Role,
    /// Position of the camera, metres.
    pub center: [f64; 3],
    /// Smallest and largest depth along the optical axis, metres.
    pub depths_m: [f64; 2],
    /// Number of points that the image sees.
    pub points: usize,
    /// The affine map from inverse depths to the values of `priors/depths`, before they are warped.
    pub disparity: DisparityMap,
}

/// Result of [`simulate_room`](crate::simulate::simulate_room) and
/// [`simulate_aerial`](crate::simulate::simulate_aerial).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TestSetSummary {
    /// The images, ordered by name.
    pub views: Vec<TestSetView>,
    /// Number of points of the COLMAP model.
    pub points: usize,
    /// Number of vertices of the exact mesh.
    pub mesh_vertices: usize,
    /// Number of triangles of the exact mesh.
    pub mesh_triangles: usize,
    /// Path of the exact mesh.
    pub mesh: PathBuf,
    /// Path of the list of images that are held back from training, if there is one.
    pub test_list: Option<PathBuf>,
}
