//! Pseudo-views and proposals (GeoProp-GS §3.2, GVA): what no view sees, but other views of the scene would show.
//!
//! The points of the aligned views are drawn from cameras beside and between those of the scene ([`poses`], [`draw`]). Holes in
//! these pictures get depths from what lies around and farther away ([`fill`]), because a hole opens where something near hid what
//! is behind it. The filled pixels give points, the proposals, unless a view would have seen them.

mod draw;
mod fill;
mod poses;

use super::hdd::cloud::{AlignedView, SurfacePoint};
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::stats::quantile;
use draw::{Drawn, draw};
use fill::fill_holes;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use poses::poses;
use rayon::prelude::*;
use std::collections::HashMap;
use std::num::NonZero;

/// Least and greatest share of pixels in holes with which a pseudo-view is used.
const HOLES: (f64, f64) = (0.03, 0.6);
/// A proposal is left out if it is nearer to a point than this many times the median spacing.
const APART: f64 = 2.0;
/// A proposal that lies in front of what a view sees by more than this share of the depth is left out.
const IN_FRONT: f64 = 0.02;
/// Largest number of proposals as a share of the number of points.
const MOST: f64 = 0.5;

/// A pseudo-view.
#[derive(Clone, Debug)]
pub struct PseudoView {
    /// Its camera.
    pub camera: PinholeCamera,
    /// Share of its pixels in holes.
    pub holes: f64,
    /// Whether it gave proposals: it has neither too few nor too many holes.
    pub is_used: bool,
    /// The points drawn: red, green, blue of each pixel, row by row. Holes are black until they are filled.
    pub colors: Vec<[u8; 3]>,
    /// Whether each pixel is in a hole.
    pub hole: Vec<bool>,
    /// Depths, in holes those that were filled in; NaN where nothing is known.
    pub depth: Grid2,
}

/// The pseudo-views of a cloud of points of these views.
pub(super) fn pseudo_views(views: &[AlignedView], cloud: &[SurfacePoint]) -> Vec<PseudoView> {
    let cameras: Vec<PinholeCamera> = views.iter().map(|v| *v.camera).collect();
    let middle = |axis: usize| quantile(cloud.iter().map(|p| p.position[axis]).collect(), 0.5);
    let (Some(x), Some(y), Some(z)) = (middle(0), middle(1), middle(2)) else {
        return Vec::new();
    };
    poses(&cameras, DVec3::new(x, y, z)).into_par_iter().map(|camera| pseudo_view(cloud, camera)).collect()
}

/// Whether each pixel of a camera shows no point, row by row.
pub(super) fn holes_of(cloud: &[SurfacePoint], camera: &PinholeCamera) -> Vec<bool> {
    draw(cloud, camera).hole
}

fn pseudo_view(cloud: &[SurfacePoint], camera: PinholeCamera) -> PseudoView {
    let Drawn { mut depth, colors, hole } = draw(cloud, &camera);
    let holes = hole.iter().filter(|h| **h).count() as f64 / hole.len().max(1) as f64;
    let is_used = (HOLES.0..=HOLES.1).contains(&holes);
    if is_used {
        fill_holes(&mut depth, &hole);
    }
    PseudoView { camera, holes, is_used, colors, hole, depth }
}

/// Points at the filled pixels, those of earlier views first.
pub(super) fn proposals(
    views: &[AlignedView],
    cloud: &[SurfacePoint],
    pseudo: &[PseudoView],
) -> Vec<SurfacePoint> {
    if !pseudo.iter().any(|view| view.is_used) {
        return Vec::new();
    }
    let positions: Vec<[f64; 3]> = cloud.iter().map(|p| p.position.to_array()).collect();
    let spacing = quantile(cloud.iter().map(|p| p.spacing).collect(), 0.5).unwrap_or_default();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return Vec::new() };
    let apart = APART * spacing;
    let is_new = |p: &SurfacePoint| {
        let at = p.position.to_array();
        let near = tree.query(&at).nearest_n::<SquaredEuclidean<f64>>(NonZero::<usize>::MIN).execute();
        near.iter().all(|n| n.distance > apart * apart)
            && !views.iter().any(|view| view.in_front(p.position).is_some_and(|share| share > IN_FRONT))
    };
    let most = (MOST * cloud.len() as f64) as usize;
    let (mut taken, mut out) = (Taken::new(apart), Vec::new());
    for view in pseudo.iter().filter(|view| view.is_used) {
        let at = |i: usize| {
            let (col, row) = (i % view.depth.width, i / view.depth.width);
            let depth = f64::from(view.depth.data[i]);
            let point = || SurfacePoint::behind(&view.camera, (col, row), depth, view.colors[i], 1);
            (view.hole[i] && depth.is_finite()).then(point).filter(is_new)
        };
        let new: Vec<SurfacePoint> = (0..view.hole.len()).into_par_iter().filter_map(at).collect();
        out.extend(new.into_iter().filter(|p| taken.take(p.position)));
    }
    // Of too many, every n-th stays.
    let every = out.len().div_ceil(most.max(1)).max(1);
    out.into_iter().step_by(every).collect()
}

/// Places that are taken: no two are nearer than a distance.
struct Taken {
    apart: f64,
    cells: HashMap<[i64; 3], Vec<DVec3>>,
}

impl Taken {
    fn new(apart: f64) -> Self {
        Self { apart: apart.max(f64::MIN_POSITIVE), cells: HashMap::new() }
    }

    /// Takes a place; false if one nearby is taken already.
    fn take(&mut self, p: DVec3) -> bool {
        let cell = (p / self.apart).floor().to_array().map(|v| v as i64);
        let around = (0..27).map(|k| [cell[0] + k % 3 - 1, cell[1] + k / 3 % 3 - 1, cell[2] + k / 9 - 1]);
        let near = |q: &DVec3| q.distance_squared(p) < self.apart * self.apart;
        if around.filter_map(|c| self.cells.get(&c)).flatten().any(near) {
            return false;
        }
        self.cells.entry(cell).or_default().push(p);
        true
    }
}

#[cfg(test)]
mod tests;
