//! Rendering a trained scene from a new camera, under any sun (novel view synthesis).

use super::objective::{SatelliteObjective, SatelliteStep};
use crate::affine::{SiteScene, SiteView, ViewCamera, sun_direction};
use crate::camera::QuadraticKernel;
use crate::io::Grid2;
use crate::scene::Sun;
use crate::splat::appearance::satgs::Cube;
use crate::splat::appearance::{Appearance, AppearanceModel, ColorInput, ModelParameters, SplatSun};
use crate::splat::loss::TermSet;
use crate::splat::primitive::PrimitiveKind;
use crate::splat::raster::{Disc, FrameCamera, Image, Rasterizer, SortedSplats, channel, renderer};
use crate::splat::sheared_camera::SunView;
use crate::splat::splats::Splats;
use crate::splat::stopwatch::Stopwatch;
use crate::splat::sun_visibility::sun_visibility;

/// A camera with its image size and the sun.
#[derive(Clone, Copy, Debug)]
pub struct NovelView {
    /// The camera.
    pub camera: ViewCamera,
    /// Image size (columns, rows), pixels.
    pub size: (usize, usize),
    /// Shear from the camera to the sun, pixels per metre of altitude; none without shadows.
    pub sun_shear: Option<[f64; 2]>,
}

/// A rendered picture.
pub struct Picture {
    /// Linear red, green and blue in [0, 1]; black where there are no splats.
    pub colors: [Grid2; 3],
    /// Altitudes, metres above the site's origin: the alpha-composited mean of the splats' altitudes; NaN where the
    /// transmittance exceeds one half.
    pub altitude: Grid2,
    /// Share of sunlight, 0 to 1; 1 without a sun.
    pub sunlight: Grid2,
}

impl SiteScene {
    /// A camera that shows the whole area in `size` (columns, rows) pixels, from the direction with this azimuth (clockwise
    /// from north) and angle from the zenith, degrees. North is up, and level ground is not distorted.
    #[must_use]
    pub fn view_from(&self, azimuth_deg: f64, off_nadir_deg: f64, size: (usize, usize)) -> ViewCamera {
        let (west, south, east, north) = self.area;
        let gsd = ((east - west) / size.0 as f64).max((north - south) / size.1 as f64);
        // The direction to the camera is computed like that to the sun.
        let [x, y, z] =
            sun_direction(Sun { azimuth_deg, elevation_deg: 90.0 - off_nadir_deg }, &self.site).xyz();
        let linear = [[1.0, 0.0, -x / z], [0.0, -1.0, y / z]].map(|l| l.map(|v| v / gsd));
        let center = [0.5 * (west + east) / gsd, -0.5 * (south + north) / gsd];
        let middle = [0.5 * (size.0 as f64 - 1.0), 0.5 * (size.1 as f64 - 1.0)];
        ViewCamera::affine(linear, [middle[0] - center[0], middle[1] - center[1]])
    }

    /// Image size (columns, rows) of the area at the reference view's ground sampling distance.
    #[must_use]
    pub fn picture_size(&self) -> (usize, usize) {
        let (west, south, east, north) = self.area;
        let gsd = self.views[self.reference].camera.gsd_m();
        (((east - west) / gsd).ceil() as usize, ((north - south) / gsd).ceil() as usize)
    }
}

impl From<&SiteView> for NovelView {
    fn from(view: &SiteView) -> Self {
        Self { camera: view.camera, size: view.size, sun_shear: view.sun_shear }
    }
}

impl NovelView {
    /// The sun; none without shadows. `altitudes` are the lowest and highest of the scene, metres.
    #[must_use]
    pub fn sun(&self, altitudes: (f64, f64)) -> Option<SunView<f32>> {
        self.sun_shear.map(|shear| SunView::new(&self.camera, self.size, shear, altitudes))
    }

    /// The colours that a model gives the splats in this view; without a sun, all are in full sunlight. `altitudes` are the
    /// lowest and highest of the scene, metres.
    pub fn splat_colors(
        &self,
        splats: &Splats,
        model: &mut dyn AppearanceModel<f32>,
        parameters: ModelParameters<f32>,
        altitudes: (f64, f64),
    ) -> Vec<[f32; 3]> {
        let (sun, mut visibility, mut colors) = (self.sun(altitudes), Vec::new(), Vec::new());
        if let Some(sun) = sun.filter(|_| model.has_shaded_splats()) {
            let mut sorted = SortedSplats::of(splats.primitive());
            sorted.update(splats);
            let altitude = |i: &u32| [splats.position[*i as usize][2]];
            let features: Vec<[f32; 1]> = sorted.order().iter().map(altitude).collect();
            let mut raster = renderer(splats.primitive());
            raster.project(&sorted, &sun.image.camera);
            raster.bin(&features);
            raster.draw([altitudes.0 as f32]);
            sun_visibility(splats, &sun.image, raster.image(), &mut visibility);
        }
        let sun = sun.map(|sun| SplatSun { direction: sun.direction, visibility: &visibility });
        model.splat_colors(ColorInput { parameters, splats, sun }, &mut colors);
        colors
    }

    /// Renders the picture of the splats with the colour model of a view. `altitudes` are the lowest and highest of the
    /// scene, metres.
    #[must_use]
    pub fn picture(&self, splats: &Splats, appearance: &Appearance, altitudes: (f64, f64)) -> Picture {
        let parameters = ModelParameters { shared: &[], view: &appearance.values };
        self.picture_of(splats, appearance.kind.model(Cube::default()), parameters, altitudes)
    }

    /// Renders the picture of the splats with a colour model. `altitudes` are the lowest and highest of the scene, metres.
    #[must_use]
    pub fn picture_of(
        &self,
        splats: &Splats,
        model: Box<dyn AppearanceModel<f32>>,
        parameters: ModelParameters<f32>,
        altitudes: (f64, f64),
    ) -> Picture {
        let no_target = Image::default();
        let input = SatelliteStep {
            camera: FrameCamera::new(&self.camera, self.size.0, self.size.1),
            target: &no_target,
            valid: &[],
            sun: self.sun(altitudes),
            visibility: None,
            crop: None,
            virtual_view: None,
            background: [0.0; 3],
            floor: altitudes.0 as f32,
            anchored: &[],
        };
        let mut objective = SatelliteObjective::new(splats.primitive(), model, TermSet::default());
        objective.forward(splats, parameters, &input, &mut Stopwatch::default());
        let (picture, view) = (objective.picture(), objective.view());
        let (mut altitude, transmittance) =
            (view.plane(channel::ALTITUDE), view.plane(channel::TRANSMITTANCE));
        for (z, t) in altitude.data.iter_mut().zip(&transmittance.data) {
            *z = if *t > 0.5 { f32::NAN } else { (*z - *t * input.floor) / (1.0 - t) };
        }
        let sunlight = objective.sunlight().plane(0);
        Picture { colors: std::array::from_fn(|c| picture.plane(c)), altitude, sunlight }
    }
}

impl NovelView {
    /// Unit normals of discs (east, north, up) on the side of the camera; NaN where the transmittance exceeds one half.
    #[must_use]
    pub fn normals(&self, splats: &Splats) -> [Grid2; 3] {
        let mut sorted = SortedSplats::of(PrimitiveKind::Disc);
        sorted.update(splats);
        let frame = FrameCamera::<QuadraticKernel<f32>>::new(&self.camera, self.size.0, self.size.1);
        let [east, north] = self.camera.line_of_sight_slope();
        let sight = [east as f32, north as f32, 1.0];
        let feature = |(rank, &i): (usize, &u32)| {
            let [x, y, z] = sorted.normal(rank);
            let side = (x * sight[0] + y * sight[1] + z * sight[2]).signum();
            [side * x, side * y, side * z, splats.position[i as usize][2]]
        };
        let features: Vec<[f32; 4]> = sorted.order().iter().enumerate().map(feature).collect();
        let mut rasterizer = Rasterizer::<f32, 4, _, Disc>::default();
        let image = rasterizer.render(&sorted, &features, &frame, [0.0; 4]);
        let (mut normals, through) = ([0, 1, 2].map(|c| image.plane(c)), image.plane(channel::TRANSMITTANCE));
        for (i, through) in through.data.iter().enumerate() {
            let length = normals.iter().map(|n| n.data[i] * n.data[i]).sum::<f32>().sqrt();
            let inverse = if *through > 0.5 { f32::NAN } else { 1.0 / length };
            normals.iter_mut().for_each(|n| n.data[i] *= inverse);
        }
        normals
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};

    fn site_scene() -> SiteScene {
        let site = SiteGrid { epsg: 32617, origin: Point::new(500_000.0, 3_357_600.0, 10.0) };
        SiteScene {
            site,
            area: (-30.0, -20.0, 30.0, 20.0),
            altitudes: (-5.0, 30.0),
            searched: (-5.0, 30.0),
            views: Vec::new(),
            reference: 0,
            is_framed: false,
            transfer_function: crate::scene::TransferFunction::default(),
        }
    }

    #[test]
    fn in_a_view_from_the_east_roofs_appear_west_of_their_base() {
        let camera = site_scene().view_from(90.0, 45.0, (120, 80));
        let (base, roof) =
            (camera.project(Point::new(0.0, 0.0, 0.0)), camera.project(Point::new(0.0, 0.0, 10.0)));
        assert!((base.col - 59.5).abs() < 1e-9 && (base.row - 39.5).abs() < 1e-9);
        assert!((roof.col - base.col + 20.0).abs() < 1e-6 && (roof.row - base.row).abs() < 1e-6);
    }

    #[test]
    fn the_shadow_of_a_roof_lies_on_the_side_away_from_the_sun() {
        let scene = site_scene();
        let mut splats = Splats::default();
        for i in -120..=120 {
            for j in -80..=80 {
                let (x, y) = (i as f32 * 0.25, j as f32 * 0.25);
                splats.push(
                    [x, y, if x.abs() < 2.0 && y.abs() < 2.0 { 10.0 } else { 0.0 }],
                    0.2,
                    0.95,
                    [0.8; 3],
                );
            }
        }
        let camera = scene.view_from(0.0, 0.0, (120, 80));
        let sun = sun_direction(Sun { azimuth_deg: 90.0, elevation_deg: 45.0 }, &scene.site);
        let view = NovelView { camera, size: (120, 80), sun_shear: Some(camera.shear_towards(sun)) };
        let picture = view.picture(&splats, &Appearance::default(), scene.altitudes);
        let at = |x: f64| {
            let p = camera.project(Point::new(x, 0.0, 0.0));
            picture.colors[0].at(p.col.round() as usize, p.row.round() as usize)
        };
        assert!(at(-10.0) < 0.2 && at(10.0) > 0.6, "{} {}", at(-10.0), at(10.0));
        assert!((picture.altitude.at(60, 40) - 10.0).abs() < 0.2);
    }
}
