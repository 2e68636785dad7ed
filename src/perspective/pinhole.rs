//! The pinhole camera.

use super::kernel::PinholeKernel;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::simd::Real;
use glam::{DMat3, DVec2, DVec3};

/// A pinhole camera in the site frame. Camera axes are those of COLMAP: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PinholeCamera {
    /// Rotation from site axes to camera axes.
    pub cam_from_site: DMat3,
    /// The projection centre, site metres.
    pub center: DVec3,
    /// Focal lengths, pixels.
    pub focal: DVec2,
    /// The principal point in centre-of-pixel coordinates (COLMAP's less half a pixel).
    pub principal: DVec2,
    /// Columns and rows of the image.
    pub size: (usize, usize),
}

impl PinholeCamera {
    /// Image position of a site point, pixels; none if the point is not in front of the camera.
    #[must_use]
    pub fn project(&self, p: Point<Site>) -> Option<Pixel<CenterPx>> {
        let c = self.cam_from_site * (DVec3::from_array(p.xyz()) - self.center);
        let px = self.focal * c.truncate() / c.z + self.principal;
        (c.z > 0.0).then(|| Pixel::new(px.x, px.y))
    }

    /// Unit vector in site axes from the projection centre through a pixel.
    #[must_use]
    pub fn ray(&self, px: Pixel<CenterPx>) -> [f64; 3] {
        let image = (DVec2::new(px.col, px.row) - self.principal) / self.focal;
        (self.cam_from_site.transpose() * image.extend(1.0)).normalize().to_array()
    }

    /// The position that a pixel shows at a depth along the optical axis, site metres.
    #[must_use]
    pub fn at_depth(&self, px: Pixel<CenterPx>, depth: f64) -> [f64; 3] {
        let image = (DVec2::new(px.col, px.row) - self.principal) / self.focal;
        (self.center + self.cam_from_site.transpose() * (depth * image.extend(1.0))).to_array()
    }

    /// Depth of a site point along the optical axis, metres; negative behind the camera.
    #[must_use]
    pub fn depth(&self, p: Point<Site>) -> f64 {
        (self.cam_from_site * (DVec3::from_array(p.xyz()) - self.center)).z
    }

    /// The camera of the image whose pixels are squares of `factor` pixels a side; pixels that do not fill a square are left out.
    #[must_use]
    pub fn reduced(&self, factor: usize) -> Self {
        let n = factor.max(1);
        Self {
            focal: self.focal / n as f64,
            principal: (self.principal + 0.5) / n as f64 - 0.5,
            size: (self.size.0 / n, self.size.1 / n),
            ..*self
        }
    }

    /// The camera of the part of the image that begins at a column and row and has this size.
    #[must_use]
    pub fn cropped(&self, (left, top): (usize, usize), size: (usize, usize)) -> Self {
        Self { principal: self.principal - DVec2::new(left as f64, top as f64), size, ..*self }
    }

    /// The kernel of the camera for the rasteriser, which draws nothing up to the depth `nearest`.
    #[must_use]
    pub fn kernel<T: Real>(&self, nearest: f64) -> PinholeKernel<T> {
        PinholeKernel::new(self.cam_from_site, self.center, [self.focal, self.principal], self.size, nearest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ray_through_the_projection_of_a_point_passes_through_the_point() {
        let camera = PinholeCamera {
            cam_from_site: DMat3::from_rotation_x(2.2) * DMat3::from_rotation_z(0.4),
            center: DVec3::new(1.0, -2.0, 30.0),
            focal: DVec2::new(700.0, 710.0),
            principal: DVec2::new(319.5, 239.5),
            size: (640, 480),
        };
        let point = camera.center + camera.cam_from_site.transpose() * DVec3::new(1.5, -0.7, 12.0);
        let [x, y, z] = point.to_array();
        let px = camera.project(Point::new(x, y, z)).unwrap();
        assert!((px.col - (700.0 * 1.5 / 12.0 + 319.5)).abs() < 1e-9);
        let along = DVec3::from_array(camera.ray(px));
        assert!(along.cross(point - camera.center).length() < 1e-9);
        let depth = camera.cam_from_site.row(2).dot(point - camera.center);
        assert!(DVec3::from_array(camera.at_depth(px, depth)).distance(point) < 1e-9);
        let part = camera.cropped((100, 200), (50, 40)).project(Point::new(x, y, z)).unwrap();
        assert!((part.col - (px.col - 100.0)).abs() < 1e-9 && (part.row - (px.row - 200.0)).abs() < 1e-9);
        let behind = camera.center - (point - camera.center);
        let [x, y, z] = behind.to_array();
        assert_eq!(camera.project(Point::new(x, y, z)), None);
    }
}
