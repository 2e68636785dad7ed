//! The affine camera, and shears of it.

use crate::camera::AffineKernel;
use crate::frame::{CenterPx, Pixel, Point, Site, SiteGrid, Vector};
use crate::scene::Sun;
use crate::simd::Real;
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// `(col, row) = linear * (x, y, z) + offset`, from site metres to pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AffineCamera {
    /// Rows (col, row), columns (east, north, up); pixels per metre.
    pub linear: [[f64; 3]; 2],
    /// Image position of the site's origin, pixels.
    pub offset: [f64; 2],
}

impl AffineCamera {
    /// Image position of a site point.
    #[must_use]
    pub fn project(&self, p: Point<Site>) -> Pixel<CenterPx> {
        let [col, row] = self.displace(p.xyz());
        Pixel::new(col + self.offset[0], row + self.offset[1])
    }

    /// Image displacement of a site displacement, pixels.
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
        [image.perp_dot(north) / det, east.perp_dot(image) / det]
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
        }
    }

    /// Ground sampling distance, metres: the square root of the area of level ground that a pixel covers.
    #[must_use]
    pub fn gsd_m(&self) -> f64 {
        let [east, north, _] = self.columns();
        east.perp_dot(north).abs().sqrt().recip()
    }
}

impl<T: Real> From<&AffineCamera> for AffineKernel<T> {
    fn from(camera: &AffineCamera) -> Self {
        Self { linear: camera.linear.map(|l| l.map(T::from_f64)), offset: camera.offset.map(T::from_f64) }
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

    fn camera() -> AffineCamera {
        AffineCamera { linear: [[3.0, 0.1, 0.6], [0.2, -2.9, 0.4]], offset: [400.0, 390.0] }
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
        let p = Point::new(12.0, -7.0, 3.0);
        let (a, b) = (camera().project(p), camera().rescaled(0.5).project(p));
        assert!(((a.col + 0.5) * 0.5 - (b.col + 0.5)).abs() < 1e-12);
        assert!(((a.row + 0.5) * 0.5 - (b.row + 0.5)).abs() < 1e-12);
    }
}
