//! Dense start (IndoorSplat §4.1): parts of views in which the scene has few points get more of them, at depths of the priors that
//! are brought to the points around.
//!
//! Each view is cut into 16 x 16 patches. Where fewer points are seen than there should be, the prior's values in a window around the
//! patch are fitted to the depths of the points that are seen there, a disparity's to the inverse depths; measured and aligned depths are
//! taken as they are. Points are then added at
//! pixels of the patch. Later views see those of earlier ones. The paper asks for 300 points in a patch; here a patch also needs no
//! more than one for each cube of the spacing that its surface passes, of which each keeps one point.

use super::fit::{Alignment, align};
use super::map::{DepthPrior, PixelColor};
use super::seen::SeenPoint;
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::io::Grid2;
use crate::perspective::{PinholeCamera, ScenePoint};
use crate::random::CounterRng;
use crate::stats::quantile;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::HashSet;
use std::num::NonZero;

/// Patches along each side of a view.
const PATCHES: usize = 16;
/// Points that a patch should have (paper); fewer, if it has fewer pixels in a picture of this width.
const POINTS: f64 = 300.0;
const POINTS_PER_PIXEL: f64 = 0.4;
const WIDTH_PX: f64 = 512.0;
/// A patch has few points with less than this share of those that it should have.
const FEW: f64 = 0.5;
/// Fewest points for a fit, and most times that the window grows by half a patch at each side to have them.
const FEWEST_POINTS: usize = 100;
const MOST_GROWTHS: usize = 6;
/// Greatest median of the absolute residuals of a fit, as a share of the median of the known values.
const GREATEST_RESIDUAL: f64 = 0.02;
/// The picture of points that hide others has a pixel for so many of the view's, and each point covers 3 x 3 of them.
const HIDING_PX: usize = 4;
/// A point that is deeper by more than this share is hidden.
const HIDDEN: f64 = 0.03;
/// Neighbouring depths that differ by more than this share are at an edge, and patches with more than this share of edges are
/// left as they are.
const EDGE: f64 = 0.05;
const MOST_EDGES: f64 = 0.01;
/// Least and greatest depth of added points, as a multiple of the least and greatest depth of the points in the window.
const DEPTHS: (f64, f64) = (0.5, 1.5);
/// An added point is left out if its mean distance to so many neighbours exceeds the mean of all by so many standard deviations.
const NEIGHBOURS: NonZero<usize> = NonZero::new(17).unwrap();
const DEVIATIONS: f64 = 3.0;
/// Purpose of the random numbers.
const DRAW_PIXEL: u64 = 21;

/// A view with depths.
pub struct DenseView<'a> {
    /// Its camera.
    pub camera: &'a PinholeCamera,
    /// Its depths.
    pub depth: &'a DepthPrior,
    /// Its colours.
    pub color: PixelColor<'a>,
}

/// What a dense start did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DenseSummary {
    /// Number of patches of all views.
    pub patches: usize,
    /// Number of those that had few points.
    pub sparse: usize,
    /// Number of sparse patches that got points.
    pub filled: usize,
    /// Number of sparse patches without enough points around.
    pub without_points: usize,
    /// Number of sparse patches to which the prior could not be fitted, or that have an edge of depths.
    pub without_fit: usize,
    /// Number of points that were added.
    pub added: usize,
    /// Median over filled patches of the median residual of the fit, as a share of the depth; zero without filled patches.
    pub residual: f64,
}

/// What became of a patch.
enum Patch {
    HasEnough,
    WithoutPoints,
    WithoutFit,
    Filled(Vec<ScenePoint>, f64),
}

/// The points of the scene and those that depths of the views add, which are `spacing_m` apart at least.
#[must_use]
pub fn dense_start(
    points: &[ScenePoint],
    views: &[DenseView],
    spacing_m: f64,
    seed: u64,
) -> (Vec<ScenePoint>, DenseSummary) {
    let cube = |p: &Point<Site>| p.xyz().map(|v| (v / spacing_m).floor() as i64);
    let mut taken: HashSet<[i64; 3]> = points.iter().map(|p| cube(&p.position)).collect();
    let mut all = points.to_vec();
    let mut summary = DenseSummary { patches: PATCHES * PATCHES * views.len(), ..DenseSummary::default() };
    let mut residuals = Vec::new();
    for (v, view) in views.iter().enumerate() {
        let seen = in_cells(seen(&all, view.camera), view.camera);
        let patches: Vec<Patch> = (0..PATCHES * PATCHES)
            .into_par_iter()
            .map(|i| patch(view, &seen, i, spacing_m, (seed, (v * PATCHES * PATCHES + i) as u64)))
            .collect();
        for patch in patches {
            summary.sparse += usize::from(!matches!(patch, Patch::HasEnough));
            match patch {
                Patch::HasEnough => {}
                Patch::WithoutPoints => summary.without_points += 1,
                Patch::WithoutFit => summary.without_fit += 1,
                Patch::Filled(more, residual) => {
                    summary.filled += 1;
                    residuals.push(residual);
                    all.extend(more.into_iter().filter(|p| taken.insert(cube(&p.position))));
                }
            }
        }
    }
    remove_outliers(&mut all, points.len());
    summary.added = all.len() - points.len();
    summary.residual = quantile(residuals, 0.5).unwrap_or_default();
    (all, summary)
}

/// The points that a camera sees and that no nearer ones hide.
fn seen(points: &[ScenePoint], camera: &PinholeCamera) -> Vec<SeenPoint> {
    let (width, height) = (camera.size.0.div_ceil(HIDING_PX), camera.size.1.div_ceil(HIDING_PX));
    let of = |(i, p): (usize, &ScenePoint)| SeenPoint::new(i, p.position, camera);
    let mut seen: Vec<SeenPoint> = points.par_iter().enumerate().filter_map(of).collect();
    let cell = |p: &SeenPoint| ((p.col + 0.5) as usize / HIDING_PX, (p.row + 0.5) as usize / HIDING_PX);
    let mut nearest = vec![f64::INFINITY; width * height];
    for p in &seen {
        let (col, row) = cell(p);
        for row in row.saturating_sub(1)..(row + 2).min(height) {
            for near in &mut nearest[row * width + col.saturating_sub(1)..row * width + (col + 2).min(width)]
            {
                *near = near.min(p.depth);
            }
        }
    }
    seen.retain(|p| {
        let (col, row) = cell(p);
        p.depth <= (1.0 + HIDDEN) * nearest[row * width + col]
    });
    seen
}

/// The points of each patch, row by row.
fn in_cells(seen: Vec<SeenPoint>, camera: &PinholeCamera) -> Vec<Vec<SeenPoint>> {
    let mut cells: Vec<Vec<SeenPoint>> = (0..PATCHES * PATCHES).map(|_| Vec::new()).collect();
    let index =
        |at: f64, size: usize| (((at + 0.5) / size as f64 * PATCHES as f64) as usize).min(PATCHES - 1);
    for p in seen {
        cells[index(p.row, camera.size.1) * PATCHES + index(p.col, camera.size.0)].push(p);
    }
    cells
}

/// Adds points to a patch of a view if it has few; `draw` is (seed, item) of the random numbers.
fn patch(view: &DenseView, cells: &[Vec<SeenPoint>], i: usize, spacing_m: f64, draw: (u64, u64)) -> Patch {
    let (width, height) = (view.camera.size.0 as f64, view.camera.size.1 as f64);
    let side = [width / PATCHES as f64, height / PATCHES as f64];
    let first = [(i % PATCHES) as f64 * side[0] - 0.5, (i / PATCHES) as f64 * side[1] - 0.5];
    let asked = POINTS.min(POINTS_PER_PIXEL * side[0] * side[1] * (WIDTH_PX / width).powi(2));
    if cells[i].len() as f64 >= FEW * asked {
        return Patch::HasEnough;
    }
    let fitted = match view.depth.kind.is_absolute() {
        true => Ok((Alignment::IDENTITY, (0.0, f64::INFINITY))),
        false => fitted(view, cells, i, (&first, &side)),
    };
    let (alignment, range) = match fitted {
        Ok(fitted) => fitted,
        Err(patch) => return patch,
    };
    let depth_of = |value: f64| view.depth.kind.of_depth(alignment.apply(value));
    let median = median_depth(&view.depth.values, &first, &side, depth_of);
    let (Some(median), false) = (median, has_edge(&view.depth.values, &first, &side, depth_of)) else {
        return Patch::WithoutFit;
    };
    // The cubes that a surface across the view passes.
    let focal = view.camera.focal;
    let cubes = side[0] * side[1] * median * median / (focal.x * focal.y * spacing_m * spacing_m);
    let wanted = asked.min(cubes);
    if cells[i].len() as f64 >= FEW * wanted {
        return Patch::HasEnough;
    }
    let count = wanted.ceil() as usize - cells[i].len();
    let points = sample(view, (&first, &side), count, &depth_of, range, draw);
    if points.is_empty() { Patch::WithoutFit } else { Patch::Filled(points, alignment.residual) }
}

/// The alignment of a patch's prior with the points around it, and the nearest and the farthest depth that it may give.
fn fitted(
    view: &DenseView,
    cells: &[Vec<SeenPoint>],
    i: usize,
    (first, side): (&[f64; 2], &[f64; 2]),
) -> Result<(Alignment, (f64, f64)), Patch> {
    let window = window(cells, i, first, side).ok_or(Patch::WithoutPoints)?;
    let pair = |p: &&SeenPoint| {
        let value = f64::from(p.nearest(&view.depth.values));
        value.is_finite().then(|| (value, view.depth.kind.of_depth(p.depth)))
    };
    let pairs: Vec<(f64, f64)> = window.iter().filter_map(pair).collect();
    if pairs.len() < FEWEST_POINTS {
        return Err(Patch::WithoutPoints);
    }
    let alignment = align(&pairs).filter(|a| a.residual <= GREATEST_RESIDUAL).ok_or(Patch::WithoutFit)?;
    let depths = window.iter().map(|p| p.depth);
    let range = depths.fold((f64::MAX, 0.0), |(low, high): (f64, f64), z| (low.min(z), high.max(z)));
    Ok((alignment, (DEPTHS.0 * range.0, DEPTHS.1 * range.1)))
}

/// The points in the smallest window around a patch that has enough of them.
fn window<'a>(
    cells: &'a [Vec<SeenPoint>],
    i: usize,
    first: &[f64; 2],
    side: &[f64; 2],
) -> Option<Vec<&'a SeenPoint>> {
    let (col, row) = (i % PATCHES, i / PATCHES);
    (0..=MOST_GROWTHS).find_map(|growths| {
        let grown = [side[0], side[1]].map(|s| 0.5 * s * growths as f64);
        let reach = growths.div_ceil(2);
        let rows = row.saturating_sub(reach)..(row + reach + 1).min(PATCHES);
        let near = rows.flat_map(|r| {
            let columns = col.saturating_sub(reach)..(col + reach + 1).min(PATCHES);
            columns.flat_map(move |c| &cells[r * PATCHES + c])
        });
        let is_inside = |at: f64, k: usize| at >= first[k] - grown[k] && at < first[k] + side[k] + grown[k];
        let inside: Vec<&SeenPoint> = near.filter(|p| is_inside(p.col, 0) && is_inside(p.row, 1)).collect();
        (inside.len() >= FEWEST_POINTS).then_some(inside)
    })
}

/// The pixels of a patch, columns and rows.
fn pixels(first: &[f64; 2], side: &[f64; 2]) -> [std::ops::Range<usize>; 2] {
    [0, 1].map(|k| first[k].ceil().max(0.0) as usize..(first[k] + side[k]).ceil().max(0.0) as usize)
}

/// The median depth of a patch; none without depths.
fn median_depth(
    values: &Grid2,
    first: &[f64; 2],
    side: &[f64; 2],
    depth_of: impl Fn(f64) -> f64,
) -> Option<f64> {
    let [cols, rows] = pixels(first, side);
    let all = rows.flat_map(|row| cols.clone().map(move |col| values.get(col as i64, row as i64)));
    let depths: Vec<f64> =
        all.map(|v| depth_of(v.into())).filter(|depth| depth.is_finite() && *depth > 0.0).collect();
    quantile(depths, 0.5)
}

/// Whether depths of a patch differ too much from one pixel to the next in too many places.
fn has_edge(values: &Grid2, first: &[f64; 2], side: &[f64; 2], depth_of: impl Fn(f64) -> f64) -> bool {
    let [cols, rows] = pixels(first, side);
    let (mut pairs, mut edges) = (0.0, 0.0);
    for row in rows.clone() {
        for col in cols.clone() {
            let depth = |c: usize, r: usize| depth_of(values.get(c as i64, r as i64).into());
            let here = depth(col, row);
            for (c, r) in [(col + 1, row), (col, row + 1)] {
                let (there, is_inside) = (depth(c, r), c < cols.end && r < rows.end);
                if is_inside && here.is_finite() && there.is_finite() {
                    pairs += 1.0;
                    edges += f64::from(u8::from((here - there).abs() > EDGE * here.min(there)));
                }
            }
        }
    }
    edges > MOST_EDGES * pairs
}

/// Points at pixels of a patch, one at a random place of each cell of a grid of about `count`.
fn sample(
    view: &DenseView,
    (first, side): (&[f64; 2], &[f64; 2]),
    count: usize,
    depth_of: &dyn Fn(f64) -> f64,
    (nearest, farthest): (f64, f64),
    (seed, item): (u64, u64),
) -> Vec<ScenePoint> {
    let mut draw = CounterRng::new(seed, DRAW_PIXEL, 0, item);
    let columns = ((count as f64 * side[0] / side[1]).sqrt().ceil() as usize).max(1);
    let rows = count.div_ceil(columns);
    let mut points = Vec::with_capacity(count);
    for cell in 0..columns * rows {
        let share = [
            ((cell % columns) as f64 + draw.uniform()) / columns as f64,
            ((cell / columns) as f64 + draw.uniform()) / rows as f64,
        ];
        let (col, row) = (first[0] + share[0] * side[0], first[1] + share[1] * side[1]);
        let depth = depth_of(view.depth.values.bilinear(col, row).into());
        let color = (view.color)(col.round().max(0.0) as usize, row.round().max(0.0) as usize);
        if let (Some(rgb), true) = (color, depth > nearest && depth < farthest) {
            let camera = view.camera;
            let ray = DVec3::from_array(camera.ray(Pixel::<CenterPx>::new(col, row)));
            let p = camera.center + ray * (depth / (camera.cam_from_site * ray).z);
            points.push(ScenePoint { position: Point::new(p.x, p.y, p.z), rgb });
        }
    }
    points
}

/// Removes points after the first `given` ones that are far from all others.
fn remove_outliers(points: &mut Vec<ScenePoint>, given: usize) {
    let positions: Vec<[f64; 3]> = points.iter().map(|p| p.position.xyz()).collect();
    let Ok(tree) = ImmutableKdTree::<f64, 3>::new_from_slice(&positions) else { return };
    let distance = |p: &[f64; 3]| {
        let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(NEIGHBOURS).execute();
        // The nearest one is the point itself.
        near.iter().map(|n| n.distance.sqrt()).sum::<f64>() / (near.len().max(2) - 1) as f64
    };
    let distances: Vec<f64> = positions[given..].par_iter().map(distance).collect();
    let n = distances.len().max(1) as f64;
    let mean = distances.iter().sum::<f64>() / n;
    let deviation = (distances.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n).sqrt();
    let mut i = 0;
    points.retain(|_| {
        i += 1;
        i <= given || distances[i - 1 - given] <= mean + DEVIATIONS * deviation
    });
}

#[cfg(test)]
mod tests;
