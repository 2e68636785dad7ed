//! What the images show of positions in the scene.

use super::image_features::{FEATURE_MAPS, FeatureMaps};
use crate::affine::TrainingView;
use crate::camera::QuadraticKernel;
use crate::frame::{CenterPx, Pixel, Point};
use crate::splat::raster::{FrameCamera, Image, Rasterizer, SortedSplats};
use crate::splat::sheared_camera::SunView;
use crate::splat::splats::Splats;
use crate::splat::sun_visibility::visibility_from;
use rayon::prelude::*;

/// What an image shows of a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageSample {
    /// Colour: linear, of photographs as displayed.
    pub color: [f32; 3],
    /// Whether nothing hides the position from the view, 0 to 1.
    pub visibility: f32,
    /// Whether nothing hides the sun from the position, 0 to 1; one without a known sun.
    pub sunlight: f32,
}

/// The images of a scene, with a surface that tells what hides what.
pub trait ImageObserver: Sync {
    /// Number of images.
    fn views(&self) -> usize;
    /// What an image shows of a position (site frame, metres); none outside of its valid pixels.
    fn observe(&self, view: usize, position: [f64; 3]) -> Option<ImageSample>;
    /// Where an image has a position (site frame, metres); none behind a camera.
    fn project(&self, view: usize, position: [f64; 3]) -> Option<Pixel<CenterPx>>;
    /// The image features of a position; none outside of the image.
    fn features(&self, view: usize, position: [f64; 3]) -> Option<[f32; FEATURE_MAPS]>;
}

/// Satellite images. A position is hidden if the surface is higher on its ray.
pub struct SatelliteImages<'a> {
    views: Vec<SatelliteImage<'a>>,
}

/// An image, with the altitudes of the surface as the satellite and the sun see it.
struct SatelliteImage<'a> {
    view: &'a TrainingView,
    features: FeatureMaps,
    seen: Altitudes,
    sunlit: Option<Altitudes>,
}

/// Altitudes of the surface in an image.
struct Altitudes {
    camera: FrameCamera<QuadraticKernel<f32>>,
    image: Image<f32>,
}

impl Altitudes {
    fn visibility(&self, position: [f32; 3]) -> f32 {
        visibility_from(&self.image, self.camera.kernel.project(position), position[2])
    }
}

impl<'a> SatelliteImages<'a> {
    /// The images of these views. `surface` are splats on the surface, `altitudes` the lowest and highest of the scene, metres.
    #[must_use]
    pub fn new(views: &'a [TrainingView], surface: &Splats, altitudes: (f64, f64)) -> Self {
        let mut sorted = SortedSplats::default();
        sorted.update(surface);
        let feature = |i: &u32| [surface.position[*i as usize][2]];
        let features: Vec<[f32; 1]> = sorted.order().iter().map(feature).collect();
        let mut raster = Rasterizer::<f32, 1>::default();
        let mut render = |camera: FrameCamera<QuadraticKernel<f32>>| {
            let image = raster.render(&sorted, &features, &camera, [altitudes.0 as f32]).clone();
            Altitudes { camera, image }
        };
        let of_view = |view: &'a TrainingView| {
            let size = (view.width, view.height);
            let sun = view.sun_shear.map(|shear| SunView::new(&view.camera, size, shear, altitudes));
            SatelliteImage {
                view,
                features: FeatureMaps::of(view.width, view.height, |col, row| view.block_mean(col, row, 1)),
                seen: render(FrameCamera::new(&view.camera, view.width, view.height)),
                sunlit: sun.map(|sun| render(sun.image.camera)),
            }
        };
        Self { views: views.iter().map(of_view).collect() }
    }

    /// For each pixel of a view the position of the surface that it shows, and its sunlight; none where there is no surface.
    #[must_use]
    pub fn shown(&self, view: usize) -> Vec<Option<([f64; 3], f32)>> {
        let SatelliteImage { view, seen, sunlit, .. } = &self.views[view];
        let pixel = |i: usize| {
            let (col, row) = (i % view.width, i / view.width);
            // Channel 1 is the transmittance.
            let (altitude, through) = (seen.image.at(0, col, row), seen.image.at(1, col, row));
            let z = f64::from(altitude);
            let [x, y] = view.camera.localize(Pixel::new(col as f64, row as f64), z);
            let sunlight = sunlit.as_ref().map_or(1.0, |s| s.visibility([x as f32, y as f32, altitude]));
            (through < 0.05).then_some(([x, y, z], sunlight))
        };
        (0..view.width * view.height).into_par_iter().map(pixel).collect()
    }
}

impl ImageObserver for SatelliteImages<'_> {
    fn views(&self) -> usize {
        self.views.len()
    }

    fn observe(&self, view: usize, position: [f64; 3]) -> Option<ImageSample> {
        let SatelliteImage { view, seen, sunlit, .. } = &self.views[view];
        let [x, y, z] = position;
        let px = view.camera.project(Point::new(x, y, z));
        let color = between(px, (view.width, view.height), |col, row| view.block_mean(col, row, 1))?;
        let position = position.map(|v| v as f32);
        Some(ImageSample {
            color,
            visibility: seen.visibility(position),
            sunlight: sunlit.as_ref().map_or(1.0, |sunlit| sunlit.visibility(position)),
        })
    }

    fn project(&self, view: usize, [x, y, z]: [f64; 3]) -> Option<Pixel<CenterPx>> {
        Some(self.views[view].view.camera.project(Point::new(x, y, z)))
    }

    fn features(&self, view: usize, position: [f64; 3]) -> Option<[f32; FEATURE_MAPS]> {
        let p = self.project(view, position)?;
        self.views[view].features.at(p.col, p.row)
    }
}

/// The colour between the four pixels around a position in an image of this size; none if one of them has no data or lies outside.
pub fn between(
    p: Pixel<CenterPx>,
    (width, height): (usize, usize),
    color: impl Fn(usize, usize) -> Option<[f32; 3]>,
) -> Option<[f32; 3]> {
    let last = |n: usize| n as f64 - 1.0;
    if !(0.0..last(width)).contains(&p.col) || !(0.0..last(height)).contains(&p.row) {
        return None;
    }
    let (col, row) = (p.col as usize, p.row as usize);
    let (u, v) = ((p.col - col as f64) as f32, (p.row - row as f64) as f32);
    let mut sum = [0.0; 3];
    let weights =
        [(0, 0, (1.0 - u) * (1.0 - v)), (1, 0, u * (1.0 - v)), (0, 1, (1.0 - u) * v), (1, 1, u * v)];
    for (c, r, weight) in weights {
        let rgb = color(col + c, row + r)?;
        (0..3).for_each(|k| sum[k] += weight * rgb[k]);
    }
    Some(sum)
}
