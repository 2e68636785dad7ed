//! The depth maps of a scene's own sensor as priors, and the normals of their surfaces.

use super::depth_normals::normals_of_depths;
use super::map::{DepthKind, DepthPrior, ViewPriors};
use crate::perspective::{PerspectiveError, PerspectiveView};

/// The priors of a view with a depth map: its depths, and normals if they are asked for.
///
/// # Errors
/// As [`PerspectiveView::read_depth`].
pub fn sensor_priors(view: &PerspectiveView, with_normals: bool) -> Result<ViewPriors, PerspectiveError> {
    let values = view.read_depth()?;
    let normal = with_normals.then(|| normals_of_depths(&values, &view.camera));
    Ok(ViewPriors { depth: Some(DepthPrior { values, kind: DepthKind::Measured }), normal })
}
