//! The points of a scene that a view sees.

use crate::frame::{Point, Site};
use crate::io::Grid2;
use crate::perspective::{PerspectiveView, PinholeCamera};
use glam::DVec3;

/// Number of cells along the longer side of a view.
const CELLS: usize = 20;
/// A point is hidden if it is deeper by more than this share than the nearest one in its cell and the eight around it.
const HIDDEN: f64 = 0.1;
/// A point that a view sees.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SeenPoint {
    /// Its index among the points.
    pub index: usize,
    /// The place in the image, 0 at the centre of the first pixel.
    pub col: f64,
    pub row: f64,
    /// Its depth along the optical axis.
    pub depth: f64,
}

impl SeenPoint {
    /// A point in a camera's image; none outside of it.
    pub fn new(index: usize, p: Point<Site>, camera: &PinholeCamera) -> Option<Self> {
        let px = camera.project(p)?;
        let depth = (camera.cam_from_site * (DVec3::from_array(p.xyz()) - camera.center)).z;
        let (width, height) = (camera.size.0 as f64 - 0.5, camera.size.1 as f64 - 0.5);
        let is_inside = px.col > -0.5 && px.row > -0.5 && px.col < width && px.row < height;
        is_inside.then_some(Self { index, col: px.col, row: px.row, depth })
    }

    /// The value of a plane of the image at the nearest pixel.
    pub fn nearest(&self, plane: &Grid2) -> f32 {
        plane.get(self.col.round() as i64, self.row.round() as i64)
    }
}

/// The points that a view is known to see; if nothing says so, those in its image, as far as they hide each other.
pub(crate) fn seen_points(points: &[Point<Site>], view: &PerspectiveView) -> Vec<SeenPoint> {
    let of = |index: usize| SeenPoint::new(index, *points.get(index)?, &view.camera);
    if !view.observed.is_empty() {
        return view.observed.iter().filter_map(|i| of(*i as usize)).collect();
    }
    let mut seen: Vec<SeenPoint> = (0..points.len()).filter_map(of).collect();
    let (width, height) = view.camera.size;
    let side = width.max(height).div_ceil(CELLS).max(1) as f64;
    // A border of one cell on each side spares the bounds.
    let stride = CELLS + 2;
    let of = |at: f64| ((at + 0.5) / side) as usize + 1;
    let cell = |p: &SeenPoint| of(p.row) * stride + of(p.col);
    let mut nearest = vec![f64::INFINITY; stride * stride];
    for p in &seen {
        nearest[cell(p)] = nearest[cell(p)].min(p.depth);
    }
    let nearest_around = |cell: usize| {
        let rows = [cell - stride, cell, cell + stride];
        rows.iter().flat_map(|c| &nearest[c - 1..=c + 1]).copied().fold(f64::INFINITY, f64::min)
    };
    seen.retain(|p| p.depth <= (1.0 + HIDDEN) * nearest_around(cell(p)));
    seen
}
