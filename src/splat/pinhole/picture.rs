//! Renders of splats by pinhole cameras, and their comparison with photographs.

use super::super::harmonics::MAX_DEGREE;
use super::super::loss::{SurfaceDepth, TermSet};
use super::super::primitive::PrimitiveKind;
use super::super::raster::{Image, channel, disc_plane};
use super::super::splats::Splats;
use super::super::stopwatch::Stopwatch;
use super::objective::{PinholeStep, objective};
use super::view::PinholeView;
use crate::io::{Grid2, RgbImage};
use crate::perspective::PinholeCamera;

/// Mean difference of colours that is shown in full red.
const LARGEST_ERROR: f32 = 0.25;

/// A picture of splats as a pinhole camera sees them.
pub struct PinholePicture {
    /// Red, green and blue as displayed, 0 to 1, on black.
    pub colors: [Grid2; 3],
    /// Depths along the optical axis, units of the camera's frame: the alpha-composited mean of the splats' depths; NaN where the
    /// transmittance exceeds one half.
    pub depth: Grid2,
    /// The share of light that the splats do not let through, 0 to 1.
    pub opacity: Grid2,
    /// Of discs: what follows from their planes.
    pub discs: Option<DiscPlanes>,
}

/// What discs show beside colour and mean depth; NaN where the transmittance exceeds one half.
pub struct DiscPlanes {
    /// Depth along the optical axis at which the transmittance falls to one half, units of the camera's frame.
    pub median_depth: Grid2,
    /// Unit normals in site axes, on the side of the camera.
    pub normals: [Grid2; 3],
}

impl DiscPlanes {
    fn of(view: &Image<f32>, opacity: &Grid2) -> Self {
        let mut median_depth = view.plane(disc_plane::MEDIAN_DEPTH);
        let mut normals = [0, 1, 2].map(|k| view.plane(channel::NORMAL + k));
        for (i, opaque) in opacity.data.iter().enumerate() {
            let length = normals.iter().map(|n| n.data[i] * n.data[i]).sum::<f32>().sqrt();
            let inverse = if *opaque < 0.5 { f32::NAN } else { 1.0 / length };
            normals.iter_mut().for_each(|n| n.data[i] *= inverse);
            if *opaque < 0.5 {
                median_depth.data[i] = f32::NAN;
            }
        }
        Self { median_depth, normals }
    }
}

impl PinholePicture {
    /// Renders the splats, but for those up to the depth `nearest`.
    #[must_use]
    pub fn render(splats: &Splats, camera: &PinholeCamera, nearest: f64) -> Self {
        let no_target = Image::default();
        let (background, sh_degree) = ([0.0; 3], MAX_DEGREE);
        let surface = SurfaceDepth::Mean;
        let input = PinholeStep {
            anchored: &[],
            camera,
            nearest,
            target: &no_target,
            valid: &[],
            priors: None,
            background,
            sh_degree,
            surface,
        };
        let primitive = splats.primitive();
        let mut objective = objective(primitive, TermSet::default());
        objective.forward(splats, &input, &mut Stopwatch::default());
        let view = objective.view();
        let mut colors = [0, 1, 2].map(|c| view.plane(c));
        colors.iter_mut().flat_map(|c| &mut c.data).for_each(|v| *v = v.clamp(0.0, 1.0));
        let is_disc = primitive == PrimitiveKind::Disc;
        let through = if is_disc { disc_plane::TRANSMITTANCE } else { channel::TRANSMITTANCE };
        let (mut depth, mut opacity) = (view.plane(channel::DEPTH), view.plane(through));
        for (depth, through) in depth.data.iter_mut().zip(&mut opacity.data) {
            let opaque = 1.0 - *through;
            *depth = if opaque < 0.5 { f32::NAN } else { *depth / opaque };
            *through = opaque;
        }
        let discs = is_disc.then(|| DiscPlanes::of(view, &opacity));
        Self { colors, depth, opacity, discs }
    }
}

/// Three panels: the photograph, the picture, and their difference (white is none, red is large).
#[must_use]
pub fn comparison(view: &PinholeView, picture: &PinholePicture) -> RgbImage {
    let byte = |v: f32| (255.0 * v.clamp(0.0, 1.0)).round() as u8;
    RgbImage::panels(view.camera.size, |col, row| {
        let (truth, rendered) = (view.color(col, row), picture.colors.each_ref().map(|c| c.at(col, row)));
        let error = truth.map(|truth| {
            let sum: f32 = truth.iter().zip(rendered).map(|(a, b)| (a - b).abs()).sum();
            let white = byte(1.0 - sum / 3.0 / LARGEST_ERROR);
            [255, white, white]
        });
        let truth = truth.map_or(RgbImage::NO_DATA, |c| c.map(byte));
        [truth, rendered.map(byte), error.unwrap_or(RgbImage::NO_DATA)]
    })
}
