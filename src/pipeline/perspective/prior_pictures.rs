//! Pictures of priors beside what was trained.

use super::start_pictures::Shades;
use crate::io::{Grid2, RgbImage, WriteError};
use crate::prior::DepthKind;
use crate::splat::pinhole::{NEAREST, PinholePicture, PinholeView};
use crate::splat::splats::Splats;
use std::path::Path;

/// Number of views that are drawn, spread over all.
const VIEWS: usize = 4;

/// Writes for some of the views that have priors the image, the rendered depth and that of the prior (near is light), the rendered
/// normals and those of the prior (red, green and blue are their components in site axes, from -1 to 1), as `NAME.png`.
pub(super) fn write_pictures(
    folder: &Path,
    views: &[PinholeView],
    splats: &Splats,
) -> Result<(), WriteError> {
    let with_priors: Vec<&PinholeView> = views.iter().filter(|v| v.priors().is_any()).collect();
    for view in with_priors.iter().step_by(with_priors.len().div_ceil(VIEWS).max(1)) {
        of_view(view, splats).write(&folder.join(format!("{}.png", view.name)))?;
    }
    Ok(())
}

fn of_view(view: &PinholeView, splats: &Splats) -> RgbImage {
    let picture = PinholePicture::render(splats, &view.camera, NEAREST);
    let (depth_prior, normal_prior) = (view.priors().depth(), view.priors().normal());
    let kind = depth_prior.map_or(DepthKind::Metric, |prior| prior.kind);
    // On the scale of the prior: disparities are compared with inverse depths.
    let near = |depth: f32| if kind == DepthKind::Disparity { depth.recip() } else { -depth };
    let near_of_prior = |value: f32| if kind == DepthKind::Disparity { value } else { -value };
    let (rendered, given) = (
        Shades::of(picture.depth.valid().map(near)),
        Shades::of(depth_prior.iter().flat_map(|prior| prior.values.valid()).map(near_of_prior)),
    );
    let normals = picture.discs.as_ref().map(|discs| &discs.normals);
    let color = |normals: Option<&[Grid2; 3]>, col, row| {
        let n = normals.map_or([f32::NAN; 3], |planes| planes.each_ref().map(|plane| plane.at(col, row)));
        let byte = |v: f32| (127.5 * (v.clamp(-1.0, 1.0) + 1.0)).round() as u8;
        if n.iter().any(|v| v.is_nan()) { RgbImage::NO_DATA } else { n.map(byte) }
    };
    RgbImage::panels(view.camera.size, |col, row| {
        let prior = depth_prior.map_or(f32::NAN, |prior| prior.values.at(col, row));
        [
            view.rgb(col, row).unwrap_or(RgbImage::NO_DATA),
            rendered.shade(near(picture.depth.at(col, row))),
            given.shade(near_of_prior(prior)),
            color(normals, col, row),
            color(normal_prior, col, row),
        ]
    })
}
