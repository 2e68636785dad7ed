//! The camera of a DSM.

use crate::affine::ViewCamera;
use crate::frame::SiteGrid;
use crate::io::MapGrid;

/// The affine camera that looks straight down and whose pixels are the cells of a map grid; it projects site coordinates in
/// metres.
#[must_use]
pub fn nadir_camera(grid: &MapGrid, site: &SiteGrid) -> ViewCamera {
    let scale = grid.cell.recip();
    let [east, north, _] = site.origin.xyz();
    ViewCamera::affine(
        [[scale, 0.0, 0.0], [0.0, -scale, 0.0]],
        [(east - grid.west) * scale - 0.5, (grid.north - north) * scale - 0.5],
    )
}
