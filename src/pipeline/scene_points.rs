//! The points that a perspective scene comes with.

use super::PipelineError;
use crate::perspective::{PerspectiveScene, ScenePoint, points_from_depths};

/// Depth maps give a point cloud to start from: that of every n-th view with one, thinned to one point in a cube of this side,
/// working units.
const DEPTHS_OF_EVERY: usize = 10;
const DEPTHS_THINNED_TO: f64 = 0.05;
/// The points of the scene, else those of its depth maps: of those that are a reference only if `of_reference`. `unit` is the
/// length of a working unit ([`WorkingFrame`](crate::splat::pinhole::WorkingFrame)) in the frame of the scene.
pub fn start_points(
    scene: &PerspectiveScene,
    unit: f64,
    of_reference: bool,
) -> Result<Vec<ScenePoint>, PipelineError> {
    Ok(match scene.points.is_empty() && starts_from_depths(scene, of_reference) {
        true => points_from_depths(scene, DEPTHS_OF_EVERY, DEPTHS_THINNED_TO * unit)?,
        false => scene.points.clone(),
    })
}

/// Whether training of a scene without points starts from its depth maps: those that are a reference only if `of_reference`.
pub fn starts_from_depths(scene: &PerspectiveScene, of_reference: bool) -> bool {
    let is_allowed = of_reference || !scene.layout.has_reference_depths();
    is_allowed && scene.training().any(|v| v.depth.is_some())
}
