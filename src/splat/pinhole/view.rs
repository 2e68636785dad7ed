//! A photograph with its camera, as training holds it in memory.

use crate::io::Grid2;
use crate::perspective::{PinholeCamera, ViewImage};
use crate::prior::ViewPriors;
use crate::splat::loss::PriorTargets;
use crate::splat::raster::Image;
use glam::DVec3;
use rayon::prelude::*;

/// The extent of a scene is the largest distance of a camera from their middle times this (3DGS).
const EXTENT: f64 = 1.1;
/// Opacity below which a pixel shows nothing.
const HALF: u8 = 128;
/// Centres that are nearer to each other than this share of their distance from the origin differ by rounding alone.
const COINCIDENT: f64 = 1e-12;

/// A photograph and its pinhole camera.
#[derive(Clone, Debug)]
pub struct PinholeView {
    /// Name of the view.
    pub name: String,
    /// Its camera.
    pub camera: PinholeCamera,
    /// Red, green and blue as displayed, 0 to 255, on black where pixels are empty, and whether the pixel has data, row by row.
    pixels: Vec<([u8; 3], bool)>,
    /// How much of each pixel is not empty, 0 to 255; no values if no pixel is empty.
    opacity: Vec<u8>,
    /// Depths and normals that are expected.
    priors: PriorTargets,
}

impl PinholeView {
    /// A view with its colours as displayed, 0 to 1; pixels where one of them is NaN have no data. Planes that are not of
    /// the size of the camera have no data at all.
    #[must_use]
    pub fn new(name: String, camera: PinholeCamera, planes: &[Grid2; 3]) -> Self {
        let count = camera.size.0 * camera.size.1;
        let pixel = |i: usize| {
            let rgb = planes.each_ref().map(|plane| plane.data.get(i).copied().unwrap_or(f32::NAN));
            let is_valid = rgb.iter().all(|v| v.is_finite());
            (rgb.map(|v| (255.0 * v).round() as u8), is_valid)
        };
        let pixels = (0..count).map(pixel).collect();
        Self { name, camera, pixels, opacity: Vec::new(), priors: PriorTargets::default() }
    }

    /// A view of an image of the size of the camera.
    #[must_use]
    pub fn of_image(name: String, camera: PinholeCamera, image: &ViewImage) -> Self {
        let opacity = image.opacity.iter().flat_map(|opacity| &opacity.data);
        let opacity = opacity.map(|v| (255.0 * v).round() as u8).collect();
        Self { opacity, ..Self::new(name, camera, &image.planes) }
    }

    /// Whether pixels are empty, in whole or in part.
    #[must_use]
    pub fn has_empty_pixels(&self) -> bool {
        !self.opacity.is_empty()
    }

    /// Whether nothing, or only a smaller part of something, is at a pixel.
    #[must_use]
    pub fn is_empty_at(&self, col: usize, row: usize) -> bool {
        col < self.camera.size.0
            && self.opacity.get(row * self.camera.size.0 + col).is_some_and(|v| *v < HALF)
    }

    /// The same view with priors of its depths and normals. Those that are not of the size of the camera are left out.
    #[must_use]
    pub fn with_priors(self, priors: ViewPriors) -> Self {
        Self { priors: PriorTargets::new(priors, &self.camera), ..self }
    }

    /// The priors of its depths and normals.
    #[must_use]
    pub fn priors(&self) -> &PriorTargets {
        &self.priors
    }

    /// The colour of a pixel on black, as displayed, 0 to 1; none outside of the image and where it has no data.
    #[must_use]
    pub fn color(&self, col: usize, row: usize) -> Option<[f32; 3]> {
        self.on_black(col, row).map(|rgb| rgb.map(|v| f32::from(v) / 255.0))
    }

    /// The colour of what a pixel shows, as displayed, 0 to 255; none outside of the image, and where it has no data or is empty.
    #[must_use]
    pub fn rgb(&self, col: usize, row: usize) -> Option<[u8; 3]> {
        self.on_black(col, row).filter(|_| !self.is_empty_at(col, row))
    }

    /// The colour of a pixel on black and how much of it is not empty, 0 to 255; none outside of the image and where it has no data.
    #[must_use]
    pub fn pixel(&self, col: usize, row: usize) -> Option<([u8; 3], u8)> {
        let opacity = self.opacity.get(row * self.camera.size.0 + col).copied().unwrap_or(u8::MAX);
        self.on_black(col, row).map(|rgb| (rgb, opacity))
    }

    fn on_black(&self, col: usize, row: usize) -> Option<[u8; 3]> {
        let (width, height) = self.camera.size;
        if col >= width || row >= height {
            return None;
        }
        let (rgb, is_valid) = *self.pixels.get(row * width + col)?;
        is_valid.then_some(rgb)
    }

    /// Writes the colours on a background, three channels from 0 to 1, and which pixels have data; the others are zero.
    pub fn load(&self, background: [f32; 3], colors: &mut Image<f32>, valid: &mut Vec<bool>) {
        let (width, height) = self.camera.size;
        colors.resize(width, height, 3);
        valid.resize(width * height, false);
        let row = width.max(1);
        let rows = colors.data.par_chunks_exact_mut(3 * row).zip(valid.par_chunks_exact_mut(row));
        rows.zip(self.pixels.par_chunks_exact(row)).with_min_len(16).for_each(|((colors, valid), pixels)| {
            for (c, colors) in colors.chunks_exact_mut(row).enumerate() {
                for (out, (rgb, is_valid)) in colors.iter_mut().zip(pixels) {
                    *out = if *is_valid { f32::from(rgb[c]) / 255.0 } else { 0.0 };
                }
            }
            valid.iter_mut().zip(pixels).for_each(|(valid, pixel)| *valid = pixel.1);
        });
        if self.has_empty_pixels() {
            let opacity = self.opacity.par_chunks_exact(row).zip(valid.par_chunks_exact(row));
            let rows = colors.data.par_chunks_exact_mut(3 * row).zip(opacity).with_min_len(16);
            rows.for_each(|(colors, (opacity, valid))| {
                for (colors, background) in colors.chunks_exact_mut(row).zip(background) {
                    for ((out, opacity), is_valid) in colors.iter_mut().zip(opacity).zip(valid) {
                        let behind = if *is_valid { 1.0 - f32::from(*opacity) / 255.0 } else { 0.0 };
                        *out += behind * background;
                    }
                }
            });
        }
    }
}

/// The extent of a scene, to which the lengths of recipes refer: 1.1 times the largest distance of a camera's centre from the
/// mean of all, in the unit of the cameras (3DGS). Of cameras in one place it is 1.
#[must_use]
pub fn extent_m(cameras: &[PinholeCamera]) -> f64 {
    let mean = cameras.iter().map(|c| c.center).sum::<DVec3>() / cameras.len().max(1) as f64;
    let farthest = cameras.iter().map(|c| c.center.distance(mean)).fold(0.0, f64::max);
    if farthest > COINCIDENT * mean.length() { EXTENT * farthest } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2};

    fn camera(x: f64) -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::new(x, 0.0, 0.0),
            focal: DVec2::splat(10.0),
            principal: DVec2::splat(1.0),
            size: (3, 2),
        }
    }

    #[test]
    fn black_pixels_are_valid_and_those_without_data_are_not() {
        let plane = Grid2::from_fn(3, 2, |col, row| match (col, row) {
            (1, 0) => f32::NAN,
            (col, row) => 0.2 * col as f32 + 0.4 * row as f32,
        });
        let view = PinholeView::new("v".into(), camera(0.0), &[plane.clone(), plane.clone(), plane]);
        let (mut colors, mut valid) = (Image::default(), Vec::new());
        view.load([0.5; 3], &mut colors, &mut valid);
        assert_eq!(valid, [true, false, true, true, true, true]);
        assert_eq!(colors.row(1, 0), [0.0, 0.0, 0.4]);
        assert_eq!((view.color(2, 1), view.color(1, 0), view.color(3, 0)), (Some([0.8; 3]), None, None));
    }

    #[test]
    fn the_background_shows_by_the_part_of_a_pixel_that_is_empty() {
        let plane = Grid2::from_fn(3, 2, |col, _| [0.0, 0.4, 0.8][col]);
        let opacity = Grid2::from_fn(3, 2, |col, row| if row == 1 { f32::NAN } else { [0.0, 0.6, 1.0][col] });
        let mut planes = [plane.clone(), plane.clone(), plane];
        (3..6).for_each(|i| planes[0].data[i] = f32::NAN);
        let image = ViewImage { planes, opacity: Some(opacity) };
        let view = PinholeView::of_image("v".into(), camera(0.0), &image);
        let (mut colors, mut valid) = (Image::default(), Vec::new());
        view.load([0.5, 0.0, 1.0], &mut colors, &mut valid);
        assert_eq!(valid, [true, true, true, false, false, false]);
        for (channel, expected) in [[0.5, 0.6, 0.8], [0.0, 0.4, 0.8], [1.0, 0.8, 0.8]].into_iter().enumerate()
        {
            let off = colors.row(channel, 0).iter().zip(expected).map(|(a, b): (&f32, f32)| (a - b).abs());
            assert!(off.fold(0.0, f32::max) < 1e-5, "{:?}", colors.row(channel, 0));
            assert_eq!(colors.row(channel, 1), [0.0; 3]);
        }
        assert_eq!((view.rgb(0, 0), view.rgb(1, 0), view.rgb(0, 1)), (None, Some([102; 3]), None));
        assert_eq!(view.color(0, 0), Some([0.0; 3]));
    }

    #[test]
    fn the_extent_is_that_of_the_cameras() {
        assert!((extent_m(&[camera(0.0), camera(1.0), camera(5.0)]) - 1.1 * 3.0).abs() < 1e-12);
        assert_eq!((extent_m(&[camera(4.0)]), extent_m(&[])), (1.0, 1.0));
    }
}
