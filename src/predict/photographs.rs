//! What photographs show of positions in the scene.
//!
//! Models know lengths in metres of satellite scenes. Photographs may be of a room or in any unit, so cameras and points are scaled
//! first, such that splats have the spacing that the model was trained with.

use super::image_features::{FEATURE_MAPS, FeatureMaps};
use super::image_network::NetworkMaps;
use super::input::SeenCloud;
use super::light::Light;
use super::observer::{ImageObserver, ImageSample, between};
use super::{CleanUp, Cloud, FEWEST_POINTS, PredictError, SplatSampling, reference};
use crate::frame::{CenterPx, Pixel, Point, SiteBox};
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::splat::init::neighbour_scales;
use crate::splat::pinhole::{NEAREST, PinholePicture, PinholeView};
use crate::splat::splats::Splats;
use crate::stats::quantile;
use rayon::prelude::*;

/// A position further behind the surface than this, metres of the model, begins to be hidden.
const BIAS_M: f64 = 1.0;
/// Rate at which visibility falls with the distance behind that, per metre of the model.
const RATE_PER_M: f64 = 1.0;

/// Splats of photographs are so many times closer than the points.
const SPLATS_OF_SPACING: f64 = 3.0;
/// The box of points of photographs leaves out this share at each side.
const OUTSIDE: f64 = 0.005;

/// A cloud of the points of photographs, enlarged to the lengths that a model knows.
pub struct EnlargedCloud {
    /// The cloud.
    pub cloud: Cloud,
    /// What the clean-up left of the points.
    pub clean_up: CleanUp,
    /// Its lengths are those of the scene times this.
    pub scale: f64,
    /// Its level box, without the outermost points.
    pub area: SiteBox,
}

impl EnlargedCloud {
    /// The cloud of these points (site frame) for a model of this sampling.
    ///
    /// # Errors
    /// [`PredictError::FewPoints`] if fewer than [`FEWEST_POINTS`] are left.
    pub fn new(points: &[[f64; 3]], sampling: &SplatSampling) -> Result<Self, PredictError> {
        let finite = points.iter().filter(|p| p.iter().all(|v| v.is_finite()));
        let points: Vec<[f64; 3]> = finite.copied().collect();
        let scale = sampling.spacing_m * SPLATS_OF_SPACING / typical_spacing(&points)?;
        let larger: Vec<[f64; 3]> = points.iter().map(|p| p.map(|v| scale * v)).collect();
        let (cloud, clean_up) = Cloud::new(&larger, sampling.spacing_m)?;
        let area = area_of(cloud.positions());
        Ok(Self { cloud, clean_up, scale, area })
    }

    /// Gives `work` the cloud with what these photographs show of it, and a network of image features if there is one.
    pub fn with_views<R>(
        &self,
        views: &[&PinholeView],
        sampling: &SplatSampling,
        maps: Option<&NetworkMaps>,
        work: impl FnOnce(&SeenCloud) -> R,
    ) -> R {
        let surface = reference::surface(&self.cloud, sampling, self.area, false);
        let images = Photographs::new(views, &surface, self.scale);
        // All photographs have the same light.
        let lights = vec![Light::default(); views.len()];
        work(&SeenCloud::new(&self.cloud, &images, &lights).with_maps(maps))
    }
}

/// Typical distance of points of photographs.
fn typical_spacing(points: &[[f64; 3]]) -> Result<f64, PredictError> {
    let found = points.len();
    let few = || PredictError::FewPoints { found, needed: FEWEST_POINTS };
    let distances: Vec<f64> =
        neighbour_scales(points).into_iter().filter(|d| d.is_finite() && *d > 0.0).collect();
    quantile(distances, 0.5).filter(|_| found >= FEWEST_POINTS).ok_or_else(few)
}

/// The level box of points without the outermost: a few float far away.
fn area_of(points: &[[f64; 3]]) -> SiteBox {
    let at =
        |axis: usize, share: f64| quantile(points.iter().map(|p| p[axis]).collect(), share).unwrap_or(0.0);
    let range = |axis: usize| {
        let (low, high) = (at(axis, OUTSIDE), at(axis, 1.0 - OUTSIDE));
        let margin = 0.02 * (high - low);
        (low - margin, high + margin)
    };
    let ((west, east), (south, north)) = (range(0), range(1));
    (west, south, east, north)
}

/// Photographs, with a surface that tells what hides what.
pub struct Photographs<'a> {
    views: Vec<Photograph<'a>>,
}

/// A photograph, with the depths of the surface.
struct Photograph<'a> {
    view: &'a PinholeView,
    camera: PinholeCamera,
    features: FeatureMaps,
    depth: Grid2,
}

impl<'a> Photographs<'a> {
    /// The photographs of these views, whose scene is enlarged by `scale`. `surface` are splats on the enlarged surface.
    #[must_use]
    pub fn new(views: &[&'a PinholeView], surface: &Splats, scale: f64) -> Self {
        let of_view = |view: &&'a PinholeView| {
            let camera = PinholeCamera { center: scale * view.camera.center, ..view.camera };
            let (width, height) = camera.size;
            let features = FeatureMaps::of(width, height, |col, row| view.color(col, row));
            Photograph {
                view,
                camera,
                features,
                depth: PinholePicture::render(surface, &camera, NEAREST).depth,
            }
        };
        Self { views: views.iter().map(of_view).collect() }
    }
}

impl ImageObserver for Photographs<'_> {
    fn views(&self) -> usize {
        self.views.len()
    }

    fn observe(&self, view: usize, position: [f64; 3]) -> Option<ImageSample> {
        let px = self.project(view, position)?;
        let Photograph { view, camera, depth, .. } = &self.views[view];
        let color = between(px, camera.size, |col, row| view.color(col, row))?;
        let own = camera.cam_from_site.row(2).dot(glam::DVec3::from_array(position) - camera.center);
        let surface = f64::from(depth.at(px.col.round() as usize, px.row.round() as usize));
        // Where there is no surface nothing hides the position.
        let behind = if surface.is_nan() { 0.0 } else { (own - surface - BIAS_M).max(0.0) };
        Some(ImageSample { color, visibility: (-RATE_PER_M * behind).exp() as f32, sunlight: 1.0 })
    }

    fn project(&self, view: usize, [x, y, z]: [f64; 3]) -> Option<Pixel<CenterPx>> {
        self.views[view].camera.project(Point::new(x, y, z))
    }

    fn features(&self, view: usize, position: [f64; 3]) -> Option<[f32; FEATURE_MAPS]> {
        let px = self.project(view, position)?;
        self.views[view].features.at(px.col, px.row)
    }
}

/// The splats of a scene that was enlarged by `scale`, at its own size.
#[must_use]
pub fn reduced(mut splats: Splats, scale: f64) -> Splats {
    let (inverse, logarithm) = ((1.0 / scale) as f32, scale.ln() as f32);
    splats.position.par_iter_mut().for_each(|p| p.iter_mut().for_each(|v| *v *= inverse));
    splats.log_scale.par_iter_mut().for_each(|s| s.iter_mut().for_each(|v| *v -= logarithm));
    splats
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec2, DVec3};

    #[test]
    fn what_lies_behind_the_surface_is_hidden_at_any_scale() {
        // The camera looks down the z axis from 10 units above a floor; each pixel has its column as brightness.
        let camera = PinholeCamera {
            cam_from_site: DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
            center: DVec3::new(0.0, 0.0, 10.0),
            focal: DVec2::splat(20.0),
            principal: DVec2::splat(19.5),
            size: (40, 40),
        };
        let plane = Grid2::from_fn(40, 40, |col, _| col as f32 / 255.0);
        let view = PinholeView::new("v".into(), camera, &[plane.clone(), plane.clone(), plane]);
        let scale = 3.0;
        let mut floor = Splats::default();
        for i in 0..10_000 {
            let [x, y] = [i % 100, i / 100].map(|k| 0.3 * (k as f32 - 50.0));
            floor.push([scale as f32 * x, scale as f32 * y, 0.0], 0.9, 0.99, [0.5; 3]);
        }
        let views = [&view];
        let images = Photographs::new(&views, &floor, scale);
        let seen = images.observe(0, [6.0, 0.0, 0.2]).unwrap();
        // 2 units beside the axis at a depth of 10: 4 pixels.
        assert!((seen.color[0] * 255.0 - 23.5).abs() < 0.1 && seen.visibility > 0.99, "{seen:?}");
        assert!(images.observe(0, [6.0, 0.0, -12.0]).unwrap().visibility < 0.01);
        assert_eq!(images.observe(0, [6.0, 0.0, 40.0]), None);
        let small = reduced(floor, scale);
        assert!(
            (small.position[0][0] + 15.0).abs() < 1e-4 && (small.log_scale[0][0].exp() - 0.3).abs() < 1e-5
        );
    }
}
