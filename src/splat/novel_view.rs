//! Pictures of a trained scene from anywhere, under any sun.

use crate::affine::SiteScene;
use crate::affine::{AffineCamera, sun_direction};
use crate::io::Grid2;
use crate::scene::Sun;
use crate::splat::appearance::Appearance;
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::objective::{Objective, ShearedCamera, StepInput};
use crate::splat::raster::{FrameCamera, Image, channel};
use crate::splat::splats::Splats;

/// A place to look from, and the light.
#[derive(Clone, Copy, Debug)]
pub struct NovelView {
    /// The camera.
    pub camera: AffineCamera,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Shear of the camera towards the sun, pixels per metre; none without shadows.
    pub sun_shear: Option<[f64; 2]>,
}

/// What is seen there.
pub struct Picture {
    /// Light, 0 to 1; black where nothing is.
    pub colors: [Grid2; 3],
    /// Altitudes in metres above the site's origin, the mean of the splats' by their light; NaN where most light passes.
    pub altitude: Grid2,
    /// Share of sunlight, 1 without a sun.
    pub sunlight: Grid2,
}

impl SiteScene {
    /// A view of the whole area from `azimuth_deg` (clockwise from north), `off_nadir_deg` from the zenith, that fits
    /// into `size` pixels; north is up, and ground at the site's origin keeps its shape.
    #[must_use]
    pub fn view_from(&self, azimuth_deg: f64, off_nadir_deg: f64, size: (usize, usize)) -> AffineCamera {
        let (west, south, east, north) = self.area;
        let gsd = ((east - west) / size.0 as f64).max((north - south) / size.1 as f64);
        // Along a ray, like along the sun's, higher points lie nearer to what looks.
        let [x, y, z] =
            sun_direction(Sun { azimuth_deg, elevation_deg: 90.0 - off_nadir_deg }, &self.site).xyz();
        let linear = [[1.0, 0.0, -x / z], [0.0, -1.0, y / z]].map(|l| l.map(|v| v / gsd));
        let center = [0.5 * (west + east) / gsd, -0.5 * (south + north) / gsd];
        let middle = [0.5 * (size.0 as f64 - 1.0), 0.5 * (size.1 as f64 - 1.0)];
        AffineCamera { linear, offset: [middle[0] - center[0], middle[1] - center[1]] }
    }

    /// Columns and rows that the area has in the reference view's pixels.
    #[must_use]
    pub fn picture_size(&self) -> (usize, usize) {
        let (west, south, east, north) = self.area;
        let gsd = self.views[self.reference].camera.gsd_m();
        (((east - west) / gsd).ceil() as usize, ((north - south) / gsd).ceil() as usize)
    }
}

impl NovelView {
    /// The picture of splats that lie between the `altitudes`, in a view's radiometry.
    #[must_use]
    pub fn picture(&self, splats: &Splats, appearance: &Appearance, altitudes: (f64, f64)) -> Picture {
        let nothing = Image::default();
        let shot = StepInput {
            camera: FrameCamera::new(&self.camera, self.size.0, self.size.1),
            target: &nothing,
            valid: &[],
            sun: self.sun_shear.map(|s| ShearedCamera::sun(&self.camera, self.size, s, altitudes)),
            virtual_view: None,
            background: [0.0; 3],
            floor: 0.0,
        };
        let mut objective = Objective::new(appearance.kind, Vec::new());
        objective.forward(splats, &appearance.values, &shot, &mut Stopwatch::default());
        let (picture, view) = (objective.picture(), objective.view());
        let (mut altitude, transmittance) =
            (view.plane(channel::ALTITUDE), view.plane(channel::TRANSMITTANCE));
        for (z, t) in altitude.data.iter_mut().zip(&transmittance.data) {
            *z = if *t > 0.5 { f32::NAN } else { *z / (1.0 - t) };
        }
        let sunlight = objective.sunlight().plane(0);
        Picture { colors: std::array::from_fn(|c| picture.plane(c)), altitude, sunlight }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};

    fn setup() -> SiteScene {
        let site = SiteGrid { epsg: 32617, origin: Point::new(500_000.0, 3_357_600.0, 10.0) };
        SiteScene {
            site,
            area: (-30.0, -20.0, 30.0, 20.0),
            altitudes: (-5.0, 30.0),
            views: Vec::new(),
            reference: 0,
            transfer_function: crate::scene::TransferFunction::default(),
        }
    }

    #[test]
    fn a_view_from_the_east_shows_roofs_west_of_their_feet() {
        let camera = setup().view_from(90.0, 45.0, (120, 80));
        let (foot, roof) =
            (camera.project(Point::new(0.0, 0.0, 0.0)), camera.project(Point::new(0.0, 0.0, 10.0)));
        assert!((foot.col - 59.5).abs() < 1e-9 && (foot.row - 39.5).abs() < 1e-9);
        assert!((roof.col - foot.col + 20.0).abs() < 1e-6 && (roof.row - foot.row).abs() < 1e-6);
    }

    #[test]
    fn a_roof_throws_its_shadow_away_from_the_sun() {
        let setup = setup();
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
        let camera = setup.view_from(0.0, 0.0, (120, 80));
        let sun = sun_direction(Sun { azimuth_deg: 90.0, elevation_deg: 45.0 }, &setup.site);
        let view = NovelView { camera, size: (120, 80), sun_shear: Some(camera.shear_towards(sun)) };
        let picture = view.picture(&splats, &Appearance::default(), setup.altitudes);
        let at = |x: f64| {
            let p = camera.project(Point::new(x, 0.0, 0.0));
            picture.colors[0].at(p.col.round() as usize, p.row.round() as usize)
        };
        assert!(at(-10.0) < 0.2 && at(10.0) > 0.6, "{} {}", at(-10.0), at(10.0));
        assert!((picture.altitude.at(60, 40) - 10.0).abs() < 0.2);
    }
}
