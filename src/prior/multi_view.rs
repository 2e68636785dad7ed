//! Depths of views brought to one scene: to its points, to the normals, and to each other.
//!
//! A wall without texture has points at its rim at most. A view that shows the rim has the wall at the right depth; one that shows only
//! the wall does not know it. If each view has the wall at another depth, the nearest copy hides the others, and training sees only
//! that one. So the surface points of all views are projected into each view. The medians of their depths are known depths there, beside
//! the points of the scene, and the means of their normals carry depths on. Of another view those points count whose depths and
//! normals are about the view's own, as on one surface.

use super::depth_normals::normals_of_depths;
use super::hdd::{FARTHEST, FEWEST_POINTS, align_depth};
use super::integration::{Integration, KnownDepth};
use super::map::{DepthKind, DepthPrior, NormalPrior, ViewPriors};
use super::seen::{SeenPoint, seen_points};
use crate::frame::{Pixel, Point, Site};
use crate::io::Grid2;
use crate::perspective::{PerspectiveView, PinholeCamera};
use crate::progress::{Event, Interrupted, Progress};
use crate::stats::{median, quantile};
use glam::DVec3;
use rayon::prelude::*;

/// Standard deviations of known depths, as shares of the depth: of a point, and of one other view.
const BY_POINT: f64 = 3e-3;
const BY_VIEW: f64 = 3e-3;
/// Depths beyond that of the farthest point of a view times this are not known: they may be the sky's, which the alignment puts there.
const MOST_BEYOND: f64 = FARTHEST - 0.1;
/// More views than this tell no more.
const MOST_VIEWS: usize = 10;
/// Depths of one surface differ by less than this share, in each round of bringing views together.
const SAME_DEPTH: [f64; 2] = [0.2, 0.1];
/// The normals of one surface have a greater cosine.
const SAME_NORMAL: f64 = 0.8;
/// Places of a cell whose depth differs by more than this share from that of its middle are on another surface.
const SAME_CELL: f64 = 0.04;
/// Changes of depths are measured at every so many pixels; a prime number, so that these are not all of one column.
const CHANGES_OF_EVERY: usize = 61;

/// Aligns depths with the points that the views see, carries them across surfaces without points by the normals, and brings views that
/// show the same surface together; `priors` and `views` are in the same order. The depths are then in units of the scene
/// ([`DepthKind::Aligned`]). A view without normals has those of its aligned depths. Depths of views that cannot be aligned stay as
/// they are.
///
/// # Errors
/// [`Interrupted`].
pub fn bring_together(
    priors: &mut [ViewPriors],
    views: &[&PerspectiveView],
    points: &[Point<Site>],
    progress: &dyn Progress,
) -> Result<(), Interrupted> {
    let with_relative_depth = priors.iter().zip(views).enumerate().filter_map(|(index, (prior, view))| {
        let depth = prior.depth.as_ref().filter(|depth| !depth.kind.is_absolute())?;
        Some((index, depth, prior.normal.as_ref(), *view))
    });
    let unaligned: Vec<_> = with_relative_depth.collect();
    if unaligned.is_empty() {
        return Ok(());
    }
    progress.event(Event::Started { stage: "bringing depths together", total: 0 });
    let align =
        |&(index, depth, normals, view)| Some((index, AlignedView::new(depth, normals, view, points)?));
    let (indices, aligned): (Vec<usize>, Vec<AlignedView>) = unaligned.par_iter().filter_map(align).unzip();
    let left = unaligned.len() - indices.len();
    let depths = together(&aligned, progress)?;
    let change = |(view, depths): (&AlignedView, &Grid2)| {
        let changes = depths.data.iter().zip(&view.integration.aligned.data).step_by(CHANGES_OF_EVERY);
        let changes = changes.map(|(a, b)| f64::from(a / b - 1.0).abs()).filter(|v| v.is_finite());
        quantile(changes.collect(), 0.5)
    };
    let changes: Vec<f64> = aligned.par_iter().zip(&depths).filter_map(change).collect();
    drop(aligned);
    for (index, values) in indices.into_iter().zip(depths) {
        priors[index].depth = Some(DepthPrior { values, kind: DepthKind::Aligned });
    }
    progress.event(Event::Finished);
    if left > 0 {
        progress.event(Event::Note(format!(
            "depths of {left} views are not aligned: the views see fewer than {FEWEST_POINTS} points of the scene, or no scale and \
             shift fit half of these"
        )));
    }
    if let Some(change) = quantile(changes.clone(), 0.5) {
        progress.event(Event::Note(format!(
            "depths of {} views are aligned with the points that they see and with each other, which changes them by {:.1} % (median)",
            changes.len(),
            100.0 * change
        )));
    }
    Ok(())
}

/// The depths of the views, in their order.
fn together(views: &[AlignedView], progress: &dyn Progress) -> Result<Vec<Grid2>, Interrupted> {
    let mut depths: Vec<Grid2> = views.par_iter().map(|view| view.depths(Vec::new())).collect();
    for same_depth in SAME_DEPTH {
        progress.check()?;
        let surfaces: Vec<Surface> =
            views.par_iter().zip(&depths).map(|(view, depths)| Surface::new(view, depths)).collect();
        let of_view = |k: usize| {
            let others = surfaces[..k].iter().chain(&surfaces[k + 1..]);
            views[k].depths(surfaces[k].known_by(others, same_depth))
        };
        depths = (0..views.len()).into_par_iter().map(of_view).collect();
    }
    Ok(depths)
}

/// A view whose depths are aligned with the points that it sees.
struct AlignedView<'a> {
    camera: &'a PinholeCamera,
    integration: Integration,
    /// The depths of the points.
    known: Vec<KnownDepth>,
}

impl<'a> AlignedView<'a> {
    /// With the normals of the surfaces that the depths show if there are no others. None if the depths cannot be aligned.
    fn new(
        depth: &DepthPrior,
        normals: Option<&NormalPrior>,
        view: &'a PerspectiveView,
        points: &[Point<Site>],
    ) -> Option<Self> {
        let (seen, camera) = (seen_points(points, view), &view.camera);
        let mut aligned = align_depth(depth, &seen).ok()?;
        let farthest = (MOST_BEYOND * seen.iter().map(|p| p.depth).fold(0.0, f64::max)) as f32;
        aligned.depth.data.iter_mut().filter(|z| **z > farthest).for_each(|z| *z = f32::NAN);
        let of_depths = normals.is_none().then(|| normals_of_depths(&aligned.depth, camera));
        let integration = Integration::new(aligned, normals.or(of_depths.as_ref())?, camera);
        let known = |&SeenPoint { col, row, depth, .. }: &SeenPoint| KnownDepth {
            col,
            row,
            depth,
            deviation: BY_POINT,
            normals: DVec3::ZERO,
        };
        Some(Self { camera, integration, known: seen.iter().map(known).collect() })
    }

    /// The depths that agree with the normals, the points, and what other views know.
    fn depths(&self, mut known: Vec<KnownDepth>) -> Grid2 {
        known.extend(&self.known);
        self.integration.depths(&known)
    }
}

/// What a view sees. The middle of each cell of its integration is a surface point, and each cell gathers the points of other views.
struct Surface<'a> {
    view: &'a AlignedView<'a>,
    depths: &'a Grid2,
    /// Positions and normals of surface points, in the frame of the scene.
    points: Vec<(DVec3, DVec3)>,
}

/// What a point of another view says of a cell.
struct Told {
    cell: usize,
    /// Number of the other view.
    by: usize,
    /// Depth of the point as a share of the view's own depth there.
    ratio: f64,
    /// Normal in camera axes.
    normal: DVec3,
}

impl<'a> Surface<'a> {
    fn new(view: &'a AlignedView, depths: &'a Grid2) -> Self {
        let mut surface = Self { view, depths, points: Vec::new() };
        let site_from_cam = view.camera.cam_from_site.transpose();
        for cell in 0..surface.columns() * depths.height.div_ceil(surface.side()) {
            let (col, row) = surface.middle(cell);
            let (depth, normal) = (f64::from(depths.at(col, row)), view.integration.normal(cell));
            if depth > 0.0 && normal.is_finite() {
                let position = view.camera.at_depth(Pixel::new(col as f64, row as f64), depth);
                surface.points.push((DVec3::from_array(position), site_from_cam * normal));
            }
        }
        surface
    }

    fn side(&self) -> usize {
        self.view.integration.side()
    }

    /// Number of cells along the width.
    fn columns(&self) -> usize {
        self.depths.width.div_ceil(self.side())
    }

    /// The pixel in the middle of a cell.
    fn middle(&self, cell: usize) -> (usize, usize) {
        let at = |k: usize, size: usize| (k * self.side() + self.side() / 2).min(size - 1);
        (at(cell % self.columns(), self.depths.width), at(cell / self.columns(), self.depths.height))
    }

    /// The depths and normals in this view that `others` know: of each cell the median and the mean over the views.
    fn known_by<'b>(
        &self,
        others: impl Iterator<Item = &'b Surface<'b>>,
        same_depth: f64,
    ) -> Vec<KnownDepth> {
        let told = |(by, other): (usize, &'b Surface<'b>)| {
            other.points.iter().filter_map(move |point| self.told(by, point, same_depth))
        };
        let mut told: Vec<Told> = others.enumerate().flat_map(told).collect();
        told.sort_by_key(|t| (t.cell, t.by));
        let of_cell = |told: &[Told]| {
            // A view that is near has many points in a cell, which are one opinion.
            let of_view = |told: &[Told]| {
                let ratio = median(told.iter().map(|t| t.ratio).collect())?;
                Some((ratio, told.iter().map(|t| t.normal).sum::<DVec3>().normalize_or_zero()))
            };
            let views: Vec<(f64, DVec3)> = told.chunk_by(|a, b| a.by == b.by).filter_map(of_view).collect();
            let ratio = median(views.iter().map(|v| v.0).collect())?;
            let (col, row) = self.middle(told[0].cell);
            Some(KnownDepth {
                col: col as f64,
                row: row as f64,
                depth: ratio * f64::from(self.depths.at(col, row)),
                deviation: BY_VIEW / (views.len().min(MOST_VIEWS) as f64).sqrt(),
                normals: views.iter().map(|v| v.1).sum(),
            })
        };
        told.chunk_by(|a, b| a.cell == b.cell).filter_map(of_cell).collect()
    }

    /// What a surface point of another view says; none if it is of another surface than the one that this view sees there.
    fn told(&self, by: usize, (position, normal): &(DVec3, DVec3), same_depth: f64) -> Option<Told> {
        let p = SeenPoint::new(0, Point::new(position.x, position.y, position.z), self.view.camera)?;
        let (col, row) = (p.col.round() as usize, p.row.round() as usize);
        let cell = row / self.side() * self.columns() + col / self.side();
        let (middle_col, middle_row) = self.middle(cell);
        let (own, middle) = (self.depths.at(col, row), self.depths.at(middle_col, middle_row));
        let (ratio, normal) = (p.depth / f64::from(own), self.view.camera.cam_from_site * *normal);
        // All are false for NaN.
        let is_same = ratio < 1.0 + same_depth
            && ratio > 1.0 / (1.0 + same_depth)
            && f64::from(own / middle - 1.0).abs() < SAME_CELL
            && normal.dot(self.view.integration.normal(cell)) > SAME_NORMAL;
        is_same.then_some(Told { cell, by, ratio, normal })
    }
}

#[cfg(test)]
mod tests {
    use super::super::hdd::AlignedDepth;
    use super::*;
    use crate::progress::NoProgress;
    use glam::{DMat3, DVec2};

    const SIZE: (usize, usize) = (160, 120);

    fn camera(x: f64, z: f64) -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::new(x, 0.0, z),
            focal: DVec2::splat(130.0),
            principal: DVec2::new(79.5, 59.5),
            size: SIZE,
        }
    }

    fn normals(normal: DVec3) -> NormalPrior {
        NormalPrior { planes: normal.to_array().map(|v| Grid2::filled(SIZE.0, SIZE.1, v as f32)) }
    }

    /// A view that has a wall across it at a depth.
    fn view<'a>(camera: &'a PinholeCamera, normals: &NormalPrior, depth: f32) -> (AlignedView<'a>, Grid2) {
        let aligned = Grid2::filled(SIZE.0, SIZE.1, depth);
        let integration = Integration::new(AlignedDepth::without_points(aligned.clone()), normals, camera);
        (AlignedView { camera, integration, known: Vec::new() }, aligned)
    }

    /// What others, each at a place along x and z, say to a view that has a wall 3.3 m before it.
    fn known(others: &[(f64, f64, f32)], normal: DVec3) -> Vec<KnownDepth> {
        let (own_camera, own_normals, normals) = (camera(0.0, 0.0), normals(DVec3::NEG_Z), normals(normal));
        let (own, depths) = view(&own_camera, &own_normals, 3.3);
        let cameras: Vec<PinholeCamera> = others.iter().map(|(x, z, _)| camera(*x, *z)).collect();
        let views: Vec<_> = others
            .iter()
            .zip(&cameras)
            .map(|((_, _, depth), camera)| view(camera, &normals, *depth))
            .collect();
        let others: Vec<Surface> = views.iter().map(|(view, depths)| Surface::new(view, depths)).collect();
        Surface::new(&own, &depths).known_by(others.iter(), 0.2)
    }

    #[test]
    fn a_wall_has_the_depth_at_which_most_other_views_have_it() {
        // The last one is nearer, has more points in a cell, and is wrong.
        let known =
            known(&[(0.1, 0.0, 3.0), (-0.1, 0.0, 3.01), (0.05, 0.0, 2.99), (0.0, 1.5, 1.9)], DVec3::NEG_Z);
        assert!(known.len() > 3500, "{} of 4800 cells", known.len());
        let near = known.iter().filter(|k| (k.depth - 3.0).abs() < 0.02).count();
        assert!(near as f64 > 0.8 * known.len() as f64, "{near} of {}", known.len());
        assert!(known.iter().all(|k| k.normals.normalize().dot(DVec3::NEG_Z) > 0.99));
    }

    #[test]
    fn what_lies_behind_or_faces_elsewhere_is_another_surface() {
        assert!(known(&[(0.0, 0.0, 4.5)], DVec3::NEG_Z).is_empty());
        assert!(known(&[(0.0, 0.0, 3.0)], DVec3::new(0.8, 0.0, -0.6)).is_empty());
    }

    #[test]
    fn views_that_know_no_points_take_the_depth_of_one_that_does() {
        let normals = normals(DVec3::NEG_Z);
        let cameras = [-0.2, 0.0, 0.2].map(|x| camera(x, 0.0));
        let mut views: Vec<AlignedView> = cameras
            .iter()
            .zip([3.0, 3.2, 2.8])
            .map(|(camera, depth)| view(camera, &normals, depth).0)
            .collect();
        let point = |k: usize| {
            let (col, row) = (5.0 + 5.0 * (k % 30) as f64, 5.0 + 5.0 * (k / 30) as f64);
            KnownDepth { col, row, depth: 3.0, deviation: BY_POINT, normals: DVec3::ZERO }
        };
        views[0].known = (0..600).map(point).collect();
        let medians: Vec<f64> = together(&views, &NoProgress)
            .unwrap()
            .iter()
            .map(|depths| quantile(depths.data.iter().map(|z| f64::from(*z)).collect(), 0.5).unwrap())
            .collect();
        assert!((medians[0] - 3.0).abs() < 0.02, "{medians:?}");
        assert!(medians[1..].iter().all(|depth| (depth - 3.0).abs() < 0.06), "{medians:?}");
    }
}
