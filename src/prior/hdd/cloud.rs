//! A point for each pixel of aligned views.

use super::super::map::PixelColor;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use glam::DVec3;
use rayon::prelude::*;

/// Pixels whose depth differs by more than this share from one beside them are at an edge, and give no point.
const EDGE: f32 = 0.05;
/// A point that lies in front of what another view sees by more than this share of the depth is left out.
const IN_FRONT: f64 = 0.03;

/// A view with depths that agree with the points of the scene.
pub(in super::super) struct AlignedView<'a> {
    pub camera: &'a PinholeCamera,
    /// Depth along the optical axis, NaN where it is unknown.
    pub depth: &'a Grid2,
    pub color: &'a PixelColor<'a>,
}

/// A point of a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in super::super) struct SurfacePoint {
    pub position: DVec3,
    pub rgb: [u8; 3],
    /// Distance to the points beside it on a surface across the view.
    pub spacing: f64,
}

impl SurfacePoint {
    /// The point at a depth behind a pixel; its neighbours are `stride` pixels away.
    pub fn behind(
        camera: &PinholeCamera,
        (col, row): (usize, usize),
        depth: f64,
        rgb: [u8; 3],
        stride: usize,
    ) -> Self {
        let ray = DVec3::from_array(camera.ray(Pixel::<CenterPx>::new(col as f64, row as f64)));
        let position = camera.center + ray * (depth / (camera.cam_from_site * ray).z);
        Self { position, rgb, spacing: stride as f64 * depth / camera.focal.min_element() }
    }

    pub fn point(&self) -> Point<Site> {
        Point::new(self.position.x, self.position.y, self.position.z)
    }
}

impl AlignedView<'_> {
    /// How far a point lies in front of what the view sees, as a share of the depth there; none where it sees nothing.
    pub fn in_front(&self, p: DVec3) -> Option<f64> {
        let px = self.camera.project(Point::new(p.x, p.y, p.z))?;
        let seen = f64::from(self.depth.get(px.col.round() as i64, px.row.round() as i64));
        let depth = (self.camera.cam_from_site * (p - self.camera.center)).z;
        seen.is_finite().then(|| 1.0 - depth / seen)
    }

    /// Whether the depth changes too much around a pixel.
    fn is_edge(&self, col: usize, row: usize) -> bool {
        let depth = self.depth.at(col, row);
        let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)]
            .map(|(dc, dr)| self.depth.get(col as i64 + dc, row as i64 + dr));
        beside.iter().any(|d| (d - depth).abs() > EDGE * depth.min(*d))
    }
}

/// Points behind every pixel of all views, or with a stride behind every second, third and so on, so that they are about as many
/// as `most` at most. Edges of depth and points in front of what other views see are left out.
pub(in super::super) fn cloud(views: &[AlignedView], most: usize) -> Vec<SurfacePoint> {
    let known: usize = views.iter().map(|v| v.depth.valid().count()).sum();
    let stride = ((known as f64 / most.max(1) as f64).sqrt().ceil() as usize).max(1);
    let of_view = |(i, view): (usize, &AlignedView)| -> Vec<SurfacePoint> {
        let rows: Vec<usize> = (stride / 2..view.depth.height).step_by(stride).collect();
        let of_row = |row: usize| {
            let columns = (stride / 2..view.depth.width).step_by(stride);
            let point = |col: usize| {
                let depth = f64::from(view.depth.at(col, row));
                let rgb = (view.color)(col, row)?;
                if !depth.is_finite() || view.is_edge(col, row) {
                    return None;
                }
                let point = SurfacePoint::behind(view.camera, (col, row), depth, rgb, stride);
                let others = views.iter().enumerate().filter(|(k, _)| *k != i);
                let hides = |(_, other): (usize, &AlignedView)| {
                    other.in_front(point.position).is_some_and(|share| share > IN_FRONT)
                };
                (!{ others }.any(hides)).then_some(point)
            };
            columns.filter_map(point).collect::<Vec<_>>()
        };
        rows.into_par_iter().map(of_row).collect::<Vec<_>>().concat()
    };
    views.iter().enumerate().flat_map(of_view).collect()
}
