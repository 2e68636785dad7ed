//! Depths of views brought to one scene: to its points, to the normals, and to each other.
//!
//! A wall without texture has points at its rim at most. A view that shows the rim has the wall at the right depth; one that shows only
//! the wall does not know it. Of surfaces that each view has at another depth the nearest hides the others, and is what training sees.
//! So the surface points of all views are projected into each view, and the medians of their depths are known depths there, beside
//! the points of the scene. Of another view those points count whose depths and normals are about the view's own, as on one surface.

use super::hdd::align_depth;
use super::integration::{KnownDepth, integrate};
use super::map::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
use super::seen::seen_points;
use crate::frame::{Point, Site};
use crate::io::Grid2;
use crate::perspective::{PerspectiveView, PinholeCamera};
use crate::progress::{Event, Progress};
use crate::stats::quantile;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Standard deviations of the depth of a point and of that of one other view, as shares of it.
const BY_POINT: f64 = 3e-3;
const BY_VIEW: f64 = 3e-3;
/// More views than this tell no more.
const MOST_VIEWS: usize = 10;
/// Depths of one surface differ by less than this share, in each round of bringing views together.
const SAME_DEPTH: [f64; 2] = [0.2, 0.1];
/// The normals of one surface have a greater cosine.
const SAME_NORMAL: f64 = 0.8;
/// Number of cells along the width of a view. The middle of each is a surface point, and each gathers the points of other views.
const CELLS: usize = 80;
/// Changes of depths are measured at every so many pixels.
const CHANGES_OF_EVERY: usize = 64;

/// Aligns depths of views that have normals too with the points that the views see, carries them across surfaces without points by
/// the normals, and brings views that show the same surface together. Depths of views with few points stay as they are.
pub(super) fn bring_together(
    priors: &mut [ViewPriors],
    views: &[&PerspectiveView],
    points: &[Point<Site>],
    progress: &dyn Progress,
) {
    let align = |(index, (prior, view)): (usize, (&ViewPriors, &&PerspectiveView))| {
        let depth = prior.depth.as_ref().filter(|depth| !depth.kind.is_absolute())?;
        let normals = prior.normal.clone()?;
        let seen = seen_points(points, view);
        let aligned = align_depth(depth, &seen).ok()?.depth;
        let known =
            seen.iter().map(|p| KnownDepth { col: p.col, row: p.row, depth: p.depth, deviation: BY_POINT });
        Some(AlignedView { index, camera: view.camera, aligned, normals, known: known.collect() })
    };
    let aligned: Vec<AlignedView> =
        priors.par_iter().zip(views.par_iter()).enumerate().filter_map(align).collect();
    let mut depths: Vec<Grid2> = aligned.par_iter().map(|view| view.integrated(Vec::new())).collect();
    for same_depth in SAME_DEPTH {
        let surfaces: Vec<Surface> =
            aligned.par_iter().zip(&depths).map(|(view, depths)| Surface::new(view, depths)).collect();
        let integrated = |(k, view): (usize, &AlignedView)| {
            let others = surfaces[..k].iter().chain(&surfaces[k + 1..]);
            view.integrated(surfaces[k].known_by(others, same_depth))
        };
        depths = aligned.par_iter().enumerate().map(integrated).collect();
    }
    let change = |(view, depths): (&AlignedView, &Grid2)| {
        let changes = depths.data.iter().zip(&view.aligned.data).step_by(CHANGES_OF_EVERY);
        let changes = changes.map(|(a, b)| f64::from(a / b - 1.0).abs()).filter(|v| v.is_finite());
        quantile(changes.collect(), 0.5)
    };
    let changes: Vec<f64> = aligned.par_iter().zip(&depths).filter_map(change).collect();
    for (view, values) in aligned.into_iter().zip(depths) {
        priors[view.index].depth = Some(DepthPrior { values, kind: DepthKind::Aligned });
    }
    if let Some(change) = quantile(changes.clone(), 0.5) {
        progress.event(Event::Note(format!(
            "depths of {} views are aligned with the points that these see, carried on by normals and brought together, which changes \
             them by {:.1} % (median)",
            changes.len(),
            100.0 * change
        )));
    }
}

/// A view whose depths are aligned with the points that it sees.
struct AlignedView {
    /// Its index among the views.
    index: usize,
    camera: PinholeCamera,
    aligned: Grid2,
    normals: NormalPrior,
    /// The depths of the points.
    known: Vec<KnownDepth>,
}

impl AlignedView {
    /// The depths that agree with the normals, the points, and what other views know.
    fn integrated(&self, mut known: Vec<KnownDepth>) -> Grid2 {
        known.extend(&self.known);
        integrate(&self.aligned, &self.normals, &known, &self.camera)
    }
}

/// What a view sees.
struct Surface<'a> {
    view: &'a AlignedView,
    depths: &'a Grid2,
    /// Side of a cell, pixels.
    side: usize,
    /// Positions and normals of surface points, in the frame of the scene.
    points: Vec<(DVec3, DVec3)>,
}

impl<'a> Surface<'a> {
    fn new(view: &'a AlignedView, depths: &'a Grid2) -> Self {
        let (side, site_from_cam) =
            (depths.width.div_ceil(CELLS).max(1), view.camera.cam_from_site.transpose());
        let mut surface = Self { view, depths, side, points: Vec::new() };
        for row in (side / 2..depths.height).step_by(side) {
            for col in (side / 2..depths.width).step_by(side) {
                let (depth, normal) = (f64::from(depths.at(col, row)), surface.normal(col, row));
                if depth > 0.0 && normal.is_finite() {
                    let at = DVec2::new(col as f64, row as f64);
                    let ray = ((at - view.camera.principal) / view.camera.focal).extend(1.0);
                    let position = view.camera.center + site_from_cam * (ray * depth);
                    surface.points.push((position, site_from_cam * normal));
                }
            }
        }
        surface
    }

    /// The normal at a pixel, in camera axes; NaN where there is none.
    fn normal(&self, col: usize, row: usize) -> DVec3 {
        DVec3::from_array(self.view.normals.planes.each_ref().map(|plane| f64::from(plane.at(col, row))))
    }

    /// The depths in this view that `others` know.
    fn known_by<'b>(
        &self,
        others: impl Iterator<Item = &'b Surface<'b>>,
        same_depth: f64,
    ) -> Vec<KnownDepth> {
        let columns = self.depths.width.div_ceil(self.side);
        // The cell of a point of another view, and its depth divided by the view's own.
        let ratio = |(position, normal): &(DVec3, DVec3)| {
            let camera = &self.view.camera;
            let px = camera.project(Point::new(position.x, position.y, position.z))?;
            let (col, row) = (px.col.round(), px.row.round());
            let own = f64::from(self.depths.get(col as i64, row as i64));
            let ratio = (camera.cam_from_site * (*position - camera.center)).z / own;
            // False for NaN too.
            if !(ratio < 1.0 + same_depth && ratio > 1.0 / (1.0 + same_depth)) {
                return None;
            }
            let (col, row) = (col as usize, row as usize);
            let cosine = (camera.cam_from_site * *normal).dot(self.normal(col, row));
            (cosine > SAME_NORMAL).then_some((row / self.side * columns + col / self.side, ratio))
        };
        let mut ratios: Vec<(usize, f64)> =
            others.flat_map(|other| &other.points).filter_map(ratio).collect();
        ratios.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let of_cell = |ratios: &[(usize, f64)]| {
            let (cell, median) = ratios[ratios.len() / 2];
            let [col, row] =
                [cell % columns, cell / columns].map(|at| (at * self.side + self.side / 2) as i64);
            let depth = median * f64::from(self.depths.get(col, row));
            let deviation = BY_VIEW / (ratios.len().min(MOST_VIEWS) as f64).sqrt();
            KnownDepth { col: col as f64, row: row as f64, depth, deviation }
        };
        ratios.chunk_by(|a, b| a.0 == b.0).map(of_cell).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;

    const SIZE: (usize, usize) = (160, 120);

    /// A view from `x` along z, of a wall across it at a depth, as the view has it.
    fn view(x: f64, depth: f32, normal: DVec3) -> (AlignedView, Grid2) {
        let camera = PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::new(x, 0.0, 0.0),
            focal: DVec2::splat(130.0),
            principal: DVec2::new(79.5, 59.5),
            size: SIZE,
        };
        let plane = |value: f64| Grid2::filled(SIZE.0, SIZE.1, value as f32);
        let normals = NormalPrior { planes: normal.to_array().map(plane) };
        let aligned = Grid2::filled(SIZE.0, SIZE.1, depth);
        (AlignedView { index: 0, camera, aligned: aligned.clone(), normals, known: Vec::new() }, aligned)
    }

    fn known(others: &[(AlignedView, Grid2)]) -> Vec<KnownDepth> {
        let (own, depths) = view(0.0, 3.3, DVec3::NEG_Z);
        let others: Vec<Surface> = others.iter().map(|(view, depths)| Surface::new(view, depths)).collect();
        Surface::new(&own, &depths).known_by(others.iter(), 0.2)
    }

    #[test]
    fn a_wall_has_the_depth_at_which_most_other_views_have_it() {
        let others = [(0.4, 3.0), (-0.3, 3.01), (0.2, 2.99), (0.1, 3.5)];
        let known = known(&others.map(|(x, depth)| view(x, depth, DVec3::NEG_Z)));
        assert!(known.len() > 3500, "{} of 4800 cells", known.len());
        let near = known.iter().filter(|k| (k.depth - 3.0).abs() < 0.02).count();
        assert!(near as f64 > 0.9 * known.len() as f64, "{near} of {}", known.len());
    }

    #[test]
    fn what_lies_behind_or_faces_elsewhere_is_another_surface() {
        assert!(known(&[view(0.0, 4.5, DVec3::NEG_Z)]).is_empty());
        assert!(known(&[view(0.0, 3.0, DVec3::new(0.8, 0.0, -0.6))]).is_empty());
    }
}
