//! The cameras of depth maps.

use crate::affine::ViewCamera;
use crate::frame::{CenterPx, Pixel, Point};
use crate::perspective::PinholeCamera;
use glam::{DVec3, Vec3};

/// The camera of a depth map, and what its depths are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthCamera {
    /// A pinhole camera; a depth is the distance along its axis, metres.
    Pinhole(PinholeCamera),
    /// A camera of parallel rays; a depth is an altitude, metres above the origin, and higher is nearer.
    Parallel {
        /// The camera.
        camera: ViewCamera,
        /// Columns and rows of the image.
        size: (usize, usize),
    },
}

impl DepthCamera {
    /// Columns and rows of the image.
    #[must_use]
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Pinhole(camera) => camera.size,
            Self::Parallel { size, .. } => *size,
        }
    }

    /// The point at a depth in a pixel, metres.
    #[must_use]
    pub fn point(&self, col: f64, row: f64, depth: f64) -> DVec3 {
        match self {
            Self::Pinhole(c) => DVec3::from_array(c.at_depth(Pixel::new(col, row), depth)),
            Self::Parallel { camera, .. } => {
                let [x, y] = camera.localize(Pixel::<CenterPx>::new(col, row), depth);
                DVec3::new(x, y, depth)
            }
        }
    }

    /// The vector by which a point of a ray moves when its depth grows by one metre; of a pinhole camera the ray is that
    /// through a pixel.
    pub(super) fn step(&self, col: f64, row: f64) -> DVec3 {
        match self {
            Self::Pinhole(_) => self.point(col, row, 1.0) - self.point(col, row, 0.0),
            Self::Parallel { camera, .. } => {
                let [east, north] = camera.line_of_sight_slope();
                DVec3::new(east, north, 1.0)
            }
        }
    }

    /// The camera near a point, in single precision.
    pub(super) fn near(&self, p: DVec3) -> NearCamera {
        match self {
            Self::Pinhole(c) => NearCamera {
                is_pinhole: true,
                at: (c.cam_from_site * (p - c.center)).as_vec3(),
                linear: c.cam_from_site.as_mat3(),
                focal: c.focal.as_vec2(),
                principal: c.principal.as_vec2(),
                rows: c.cam_from_site.as_mat3(),
                line: Vec3::ZERO,
            },
            Self::Parallel { camera, .. } => {
                let tangent = camera.tangent_at(Point::new(p.x, p.y, p.z));
                let px = camera.project(Point::new(p.x, p.y, p.z));
                let [col, row] = tangent.linear;
                let linear = glam::DMat3::from_cols_array(&[
                    col[0], row[0], 0.0, col[1], row[1], 0.0, col[2], row[2], 1.0,
                ]);
                NearCamera {
                    is_pinhole: false,
                    at: DVec3::new(px.col, px.row, p.z).as_vec3(),
                    linear: linear.as_mat3(),
                    focal: glam::Vec2::ONE,
                    principal: glam::Vec2::ZERO,
                    rows: glam::Mat3::IDENTITY,
                    line: self.step(0.0, 0.0).as_vec3(),
                }
            }
        }
    }
}

/// A camera in single precision, near the point that it was made for.
#[derive(Clone, Copy, Debug)]
pub(super) struct NearCamera {
    is_pinhole: bool,
    /// What `linear` adds to: of the pinhole camera the coordinates of the point in its axes, of parallel rays its column, row
    /// and altitude.
    at: Vec3,
    linear: glam::Mat3,
    /// Rotation from site to camera axes.
    rows: glam::Mat3,
    focal: glam::Vec2,
    principal: glam::Vec2,
    /// Along a parallel ray, one metre up.
    line: Vec3,
}

/// Where a camera sees a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub col: f32,
    pub row: f32,
    /// Depth of the point.
    pub depth: f32,
    /// Of a pinhole camera the ray through the point for a depth of one metre, in its axes.
    pub ray: Vec3,
}

impl NearCamera {
    /// Where the camera sees the point at an offset (metres) from the point it was made for.
    #[inline]
    pub fn see(&self, offset: Vec3) -> Option<Seen> {
        let c = self.at + self.linear * offset;
        if !self.is_pinhole {
            return Some(Seen { col: c.x, row: c.y, depth: c.z, ray: Vec3::ZERO });
        }
        if c.z <= 0.0 {
            return None;
        }
        let ray = c / c.z;
        let px = self.focal * ray.truncate() + self.principal;
        Some(Seen { col: px.x, row: px.y, depth: c.z, ray })
    }

    /// By how much a point is nearer to the camera than a surface, in the metres of the depths.
    #[inline]
    pub fn nearer(&self, point: f32, surface: f32) -> f32 {
        if self.is_pinhole { surface - point } else { point - surface }
    }

    /// Distance from a surface for each metre that a point on a ray is nearer. Without a normal it is taken along the ray of
    /// a pinhole camera, and straight up under parallel rays, where surfaces are mostly level.
    #[inline]
    pub fn distance_by_depth(&self, seen: &Seen, normal: Option<Vec3>) -> f32 {
        match normal {
            Some(normal) if self.is_pinhole => (self.rows * normal).dot(seen.ray).abs(),
            Some(normal) => self.line.dot(normal).abs(),
            None if self.is_pinhole => seen.ray.length(),
            None => 1.0,
        }
    }
}
