//! The camera of a view, and shears of it.

use crate::camera::QuadraticKernel;
use crate::frame::{CenterPx, Pixel, Point, Site, SiteGrid, Vector};
use crate::scene::Sun;
use crate::simd::Real;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// `(col, row) = linear (x, y, z) + offset + quadratic (xx, xy, xz, yy, yz, zz)`, from site metres to pixels: an
/// affine camera with a quadratic term, which follows an RPC to about 0.01 pixels over 650 x 650 m and heights of 150 m.
///
/// Directions and scales (shears, lines of sight, the ground sampling distance) are those of the affine part:
/// the slope of the quadratic term is below a hundredth of a pixel per metre.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewCamera {
    /// Rows (col, row), columns (east, north, up); pixels per metre.
    pub linear: [[f64; 3]; 2],
    /// Image position of the site's origin, pixels.
    pub offset: [f64; 2],
    /// Rows (col, row), pixels per square metre; zero for an affine camera.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub quadratic: [[f64; 6]; 2],
}

/// Number of fixed-point steps by which [`ViewCamera::localize`] accounts for the quadratic term. The term changes
/// by less than a hundredth of a pixel while a point moves by a pixel, so that each step gains two digits.
const LOCALIZE_STEPS: usize = 4;

fn is_zero(quadratic: &[[f64; 6]; 2]) -> bool {
    quadratic.as_flattened().iter().all(|v| *v == 0.0)
}

impl ViewCamera {
    /// A camera without quadratic term.
    #[must_use]
    pub fn affine(linear: [[f64; 3]; 2], offset: [f64; 2]) -> Self {
        Self { linear, offset, quadratic: Default::default() }
    }

    /// Image position of a site point.
    #[must_use]
    pub fn project(&self, p: Point<Site>) -> Pixel<CenterPx> {
        let [col, row] = self.displace(p.xyz());
        let [bend_col, bend_row] = self.quadratic_term(p.xyz());
        Pixel::new(col + self.offset[0] + bend_col, row + self.offset[1] + bend_row)
    }

    /// The quadratic term at a site point, pixels.
    fn quadratic_term(&self, [x, y, z]: [f64; 3]) -> [f64; 2] {
        self.quadratic.map(|[xx, xy, xz, yy, yz, zz]| {
            (xx * x + xy * y + xz * z) * x + (yy * y + yz * z) * y + zz * z * z
        })
    }

    /// The affine camera that agrees with this one at a site point and in its derivatives there.
    #[must_use]
    pub fn tangent_at(&self, p: Point<Site>) -> Self {
        let [x, y, z] = p.xyz();
        let slope = self.quadratic.map(|[xx, xy, xz, yy, yz, zz]| {
            [2.0 * xx * x + xy * y + xz * z, xy * x + 2.0 * yy * y + yz * z, xz * x + yz * y + 2.0 * zz * z]
        });
        let linear = std::array::from_fn(|i| std::array::from_fn(|k| self.linear[i][k] + slope[i][k]));
        // A homogeneous quadratic is half of its slope times the point.
        let term = self.quadratic_term([x, y, z]);
        Self::affine(linear, std::array::from_fn(|i| self.offset[i] - term[i]))
    }

    /// Image displacement of a site displacement by the affine part, pixels.
    #[must_use]
    pub fn displace(&self, v: [f64; 3]) -> [f64; 2] {
        self.linear.map(|l| l[0] * v[0] + l[1] * v[1] + l[2] * v[2])
    }

    /// The sheared camera, whose image of a point is `(col, row) - shear * altitude`. `shear` is in pixels per metre.
    #[must_use]
    pub fn sheared(&self, shear: [f64; 2]) -> Self {
        let mut out = *self;
        for (line, s) in out.linear.iter_mut().zip(shear) {
            line[2] -= s;
        }
        out
    }

    /// The shear (pixels per metre of altitude) after which the camera looks along `direction`: points along
    /// it then share a pixel. `direction` must point upwards.
    #[must_use]
    pub fn shear_towards(&self, direction: Vector<Site>) -> [f64; 2] {
        let d = direction.xyz();
        self.displace([d[0] / d[2], d[1] / d[2], 1.0])
    }

    /// The unit vector towards which [`ViewCamera::sheared`] by `shear` looks; the inverse of [`ViewCamera::shear_towards`].
    #[must_use]
    pub fn direction_of(&self, shear: [f64; 2]) -> [f64; 3] {
        let [east, north] = self.sheared(shear).line_of_sight_slope();
        let length = (east * east + north * north + 1.0).sqrt();
        [east / length, north / length, 1.0 / length]
    }

    /// Ground displacement (metres east and north) per metre of height along a line of sight, towards the camera.
    #[must_use]
    pub fn line_of_sight_slope(&self) -> [f64; 2] {
        let [east, north, up] = self.columns();
        // The solution of (east, north) slope = -up.
        let det = east.perp_dot(north);
        [north.perp_dot(up) / det, up.perp_dot(east) / det]
    }

    /// The parallax of two cameras: ground displacement between them per metre of height, as in the base-to-height ratio.
    #[must_use]
    pub fn parallax(&self, other: &Self) -> f64 {
        let [a, b] = [self, other].map(Self::line_of_sight_slope);
        (a[0] - b[0]).hypot(a[1] - b[1])
    }

    /// The point (east and north, site metres) at a given altitude that a pixel shows.
    #[must_use]
    pub fn localize(&self, px: Pixel<CenterPx>, altitude: f64) -> [f64; 2] {
        let [east, north, up] = self.columns();
        let image =
            DVec2::new(px.col - self.offset[0] - up.x * altitude, px.row - self.offset[1] - up.y * altitude);
        let det = east.perp_dot(north);
        let ground = |image: DVec2| [image.perp_dot(north) / det, east.perp_dot(image) / det];
        let start = ground(image);
        if is_zero(&self.quadratic) {
            return start;
        }
        (0..LOCALIZE_STEPS)
            .fold(start, |[x, y], _| ground(image - DVec2::from_array(self.quadratic_term([x, y, altitude]))))
    }

    /// Columns of the linear part: image displacements of a metre to the east, to the north and up, pixels.
    fn columns(&self) -> [DVec2; 3] {
        let [col, row] = self.linear;
        std::array::from_fn(|k| DVec2::new(col[k], row[k]))
    }

    /// The camera of a window of the image, whose pixel (0, 0) is pixel `(col, row)` of this image.
    #[must_use]
    pub fn cropped(&self, col: f64, row: f64) -> Self {
        Self { offset: [self.offset[0] - col, self.offset[1] - row], ..*self }
    }

    /// The camera of the image resampled by `factor` (new size / old size). The outer corners of the image
    /// stay the same: the centre of the first pixel moves.
    #[must_use]
    pub fn rescaled(&self, factor: f64) -> Self {
        Self {
            linear: self.linear.map(|l| l.map(|v| v * factor)),
            offset: self.offset.map(|v| factor * (v + 0.5) - 0.5),
            quadratic: self.quadratic.map(|q| q.map(|v| v * factor)),
        }
    }

    /// Ground sampling distance, metres: the square root of the area of level ground that a pixel covers.
    #[must_use]
    pub fn gsd_m(&self) -> f64 {
        let [east, north, _] = self.columns();
        east.perp_dot(north).abs().sqrt().recip()
    }
}

impl<T: Real> From<&ViewCamera> for QuadraticKernel<T> {
    fn from(camera: &ViewCamera) -> Self {
        Self {
            linear: camera.linear.map(|l| l.map(T::from_f64)),
            offset: camera.offset.map(T::from_f64),
            quadratic: camera.quadratic.map(|q| q.map(T::from_f64)),
        }
    }
}

/// Unit vector from the ground to the sun in site axes. The azimuth of the sun is relative to true north,
/// from which the north of the map grid differs by the meridian convergence.
#[must_use]
pub fn sun_direction(sun: Sun, site: &SiteGrid) -> Vector<Site> {
    let azimuth = (sun.azimuth_deg - site.convergence_deg()).to_radians();
    let elevation = sun.elevation_deg.to_radians();
    let level = elevation.cos();
    Vector::new(azimuth.sin() * level, azimuth.cos() * level, elevation.sin())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Geodetic;

    fn camera() -> ViewCamera {
        ViewCamera::affine([[3.0, 0.1, 0.6], [0.2, -2.9, 0.4]], [400.0, 390.0])
    }

    /// A camera whose term reaches several pixels at 300 m, more than that of satellites.
    fn curved() -> ViewCamera {
        let quadratic = [[2e-5, -1e-5, 3e-5, 1e-5, -2e-5, 1e-5], [-1e-5, 2e-5, 1e-5, -3e-5, 2e-5, -1e-5]];
        ViewCamera { quadratic, ..camera() }
    }

    #[test]
    fn points_along_a_ray_of_the_sun_share_a_pixel_of_the_camera_sheared_towards_it() {
        let site = SiteGrid::at(Point::<Geodetic>::new(5.44, 43.26, 100.0)).unwrap();
        let d = sun_direction(Sun { azimuth_deg: 150.0, elevation_deg: 35.0 }, &site);
        let cam = camera();
        let sun = cam.sheared(cam.shear_towards(d));
        let p = Point::new(12.0, -7.0, 3.0);
        let q = p + Vector::new(20.0 * d.xyz()[0], 20.0 * d.xyz()[1], 20.0 * d.xyz()[2]);
        assert!(sun.project(p).distance(sun.project(q)) < 1e-9);
        let back = cam.direction_of(cam.shear_towards(d));
        assert!(back.iter().zip(d.xyz()).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        assert!(cam.project(p).distance(cam.project(q)) > 1.0);
    }

    #[test]
    fn the_azimuth_of_the_sun_is_corrected_by_the_meridian_convergence() {
        // PROJ gives a convergence of 1.6727 degrees near Marseille.
        let site = SiteGrid::at(Point::<Geodetic>::new(5.44, 43.26, 0.0)).unwrap();
        let d = sun_direction(Sun { azimuth_deg: 180.0, elevation_deg: 45.0 }, &site).xyz();
        let grid_azimuth = d[0].atan2(d[1]).to_degrees();
        assert!((grid_azimuth - (180.0 - 1.672_7)).abs() < 1e-3, "{grid_azimuth}");
    }

    #[test]
    fn rescaling_preserves_the_corners_of_the_image() {
        let p = Point::new(212.0, -107.0, 33.0);
        for camera in [camera(), curved()] {
            let (a, b) = (camera.project(p), camera.rescaled(0.5).project(p));
            assert!(((a.col + 0.5) * 0.5 - (b.col + 0.5)).abs() < 1e-12);
            assert!(((a.row + 0.5) * 0.5 - (b.row + 0.5)).abs() < 1e-12);
        }
    }

    #[test]
    fn localizing_a_projected_point_gives_the_point() {
        for p in [Point::new(320.0, -310.0, 80.0), Point::new(-325.0, -325.0, -20.0)] {
            for camera in [camera(), curved(), curved().rescaled(0.25).cropped(10.0, 20.0)] {
                let [x, y] = camera.localize(camera.project(p), p.z());
                assert!(camera.project(Point::new(x, y, p.z())).distance(camera.project(p)) < 1e-6);
                assert!((x - p.x()).hypot(y - p.y()) < 1e-6);
            }
        }
    }

    #[test]
    fn the_tangent_agrees_at_its_point_and_nearly_so_beside_it() {
        let (camera, p) = (curved(), Point::new(300.0, -200.0, 50.0));
        let tangent = camera.tangent_at(p);
        assert!(tangent.project(p).distance(camera.project(p)) < 1e-9);
        let beside = p + Vector::new(1.0, 1.0, 1.0);
        assert!(tangent.project(beside).distance(camera.project(beside)) < 2e-4);
    }

    #[test]
    fn the_quadratic_term_is_written_only_where_there_is_one() {
        let text = |camera: ViewCamera| serde_json::to_string(&camera).unwrap();
        assert!(!text(camera()).contains("quadratic"));
        for camera in [camera(), curved()] {
            assert_eq!(serde_json::from_str::<ViewCamera>(&text(camera)).unwrap(), camera);
        }
    }

    #[test]
    fn a_sheared_camera_displaces_by_altitude_alone() {
        let (camera, p, shear) = (curved(), Point::new(300.0, -200.0, 50.0), [1.5, -0.75]);
        let (a, b) = (camera.project(p), camera.sheared(shear).project(p));
        assert!((a.col - 75.0 - b.col).hypot(a.row + 37.5 - b.row) < 1e-9);
    }
}
