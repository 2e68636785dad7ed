//! A cloud of points: its clean-up, the plane around each point, and the search for the nearest points.

use super::PredictError;
use crate::frame::SiteBox;
use crate::stats::quantile;
use glam::DVec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::num::NonZero;

/// Number of points, the point itself among them, whose plane is that of a point.
const PLANE_POINTS: NonZero<usize> = NonZero::new(12).unwrap();
/// Number of nearest points whose mean distance tells outliers, and the point itself.
const OUTLIER_POINTS: NonZero<usize> = NonZero::new(9).unwrap();
/// Outliers are further from others than the median of their cell by so many normalised median absolute deviations and by this
/// factor.
const OUTLIER_DEVIATIONS: f64 = 3.0;
const OUTLIER_FACTOR: f64 = 2.0;
/// Side of the cells whose points are compared with each other, in metres and in spacings of the points, whichever is more.
const CELL_M: f64 = 16.0;
const CELL_SPACINGS: f64 = 8.0;
/// Fewest points of a cloud.
pub const FEWEST_POINTS: usize = 20;
/// Level cells of this side, in metres, have the lowest height of the ground around a point.
const GROUND_CELL_M: f64 = 5.0;

/// The plane of the points around a point, in the sense of least squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalPlane {
    /// A point of the plane: the mean of the points.
    pub center: DVec3,
    /// Unit normal, upwards.
    pub normal: DVec3,
    /// Root mean square distance of the points from it, metres.
    pub rms_m: f64,
}

impl LocalPlane {
    /// The nearest point of the plane.
    #[must_use]
    pub fn nearest(&self, p: DVec3) -> DVec3 {
        p - self.normal * self.normal.dot(p - self.center)
    }
}

/// How many points the clean-up left.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CleanUp {
    /// Number of points in the area.
    pub given: usize,
    /// Number of points after those in the same voxel were merged.
    pub merged: usize,
    /// Number of points that are far from all others and were dropped.
    pub dropped: usize,
}

impl CleanUp {
    /// Part of the merged points that was dropped.
    #[must_use]
    pub fn dropped_share(&self) -> f64 {
        self.dropped as f64 / self.merged.max(1) as f64
    }
}

/// A cloud without outliers, at most one point a voxel.
pub struct Cloud {
    positions: Vec<[f64; 3]>,
    planes: Vec<LocalPlane>,
    /// Root mean square distance of each point from its nearest three, metres.
    spacings: Vec<f64>,
    tree: ImmutableKdTree<f64, 3>,
    /// Typical distance of neighbouring points, metres.
    spacing_m: f64,
    /// Lowest heights of level cells around each, metres.
    ground: BTreeMap<[i64; 2], f64>,
    /// Side of these cells, metres.
    ground_cell_m: f64,
}

impl Cloud {
    /// The cloud of these points, merged to voxels of this side. Points that are not finite count as outliers.
    ///
    /// # Errors
    /// [`PredictError::FewPoints`] if fewer than [`FEWEST_POINTS`] are left.
    pub fn new(points: &[[f64; 3]], voxel_m: f64) -> Result<(Self, CleanUp), PredictError> {
        let finite: Vec<[f64; 3]> =
            points.iter().copied().filter(|p| p.iter().all(|v| v.is_finite())).collect();
        let merged = voxel_means(&finite, voxel_m);
        let positions = without_outliers(&merged)?;
        let not_finite = points.len() - finite.len();
        let clean_up = CleanUp {
            given: points.len(),
            merged: merged.len() + not_finite,
            dropped: merged.len() - positions.len() + not_finite,
        };
        Ok((Self::of(positions)?, clean_up))
    }

    /// The cloud of these points as they are.
    fn of(positions: Vec<[f64; 3]>) -> Result<Self, PredictError> {
        let found = positions.len();
        let few = || PredictError::FewPoints { found, needed: FEWEST_POINTS };
        if found < FEWEST_POINTS {
            return Err(few());
        }
        let tree = ImmutableKdTree::new_from_slice(&positions).map_err(|_| few())?;
        let around = |p: &[f64; 3]| {
            let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(PLANE_POINTS).execute();
            let three = near.iter().skip(1).take(3);
            let square = three.clone().map(|n| n.distance).sum::<f64>() / three.count().max(1) as f64;
            (plane(near.iter().map(|n| positions[n.item as usize])), square.sqrt())
        };
        let (planes, spacings): (Vec<_>, Vec<_>) = positions.par_iter().map(around).unzip();
        let spacing_m = quantile(spacings.clone(), 0.5).ok_or_else(few)?;
        let ground_cell_m = GROUND_CELL_M.max(2.0 * spacing_m);
        let ground = lowest_around(&positions, ground_cell_m);
        Ok(Self { positions, planes, spacings, tree, spacing_m, ground, ground_cell_m })
    }

    /// The positions.
    #[must_use]
    pub fn positions(&self) -> &[[f64; 3]] {
        &self.positions
    }

    /// The plane around each point.
    #[must_use]
    pub fn planes(&self) -> &[LocalPlane] {
        &self.planes
    }

    /// Root mean square distance of each point from its nearest three, metres.
    #[must_use]
    pub fn spacings(&self) -> &[f64] {
        &self.spacings
    }

    /// Typical distance of neighbouring points, metres.
    #[must_use]
    pub fn spacing_m(&self) -> f64 {
        self.spacing_m
    }

    /// Indices of the nearest points and their squared distances, the nearest first.
    pub fn nearest(&self, p: [f64; 3], count: NonZero<usize>) -> impl Iterator<Item = (usize, f64)> {
        let near = self.tree.query(&p).nearest_n::<SquaredEuclidean<f64>>(count).execute();
        near.into_iter().map(|n| (n.item as usize, n.distance))
    }

    /// Height above the lowest points around, metres.
    #[must_use]
    pub fn above_ground_m(&self, p: [f64; 3]) -> f64 {
        self.ground.get(&cell(p, self.ground_cell_m)).map_or(0.0, |lowest| p[2] - lowest)
    }
}

/// Whether a position lies in a level area that is wider by a margin on all sides, metres. Western and southern borders belong to it.
#[must_use]
pub fn is_within((west, south, east, north): SiteBox, margin_m: f64, [x, y, _]: [f64; 3]) -> bool {
    (west - margin_m..east + margin_m).contains(&x) && (south - margin_m..north + margin_m).contains(&y)
}

/// The level cell of a position.
fn cell(p: [f64; 3], side: f64) -> [i64; 2] {
    [p[0], p[1]].map(|v| (v / side).floor() as i64)
}

/// For each cell with points or beside one, the lowest point there and in the eight cells around.
fn lowest_around(positions: &[[f64; 3]], side: f64) -> BTreeMap<[i64; 2], f64> {
    let mut out = BTreeMap::new();
    for p in positions {
        let [x, y] = cell(*p, side);
        for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
            let lowest = out.entry([x + dx, y + dy]).or_insert(f64::INFINITY);
            *lowest = lowest.min(p[2]);
        }
    }
    out
}

/// The plane of points in the sense of least squares.
fn plane(points: impl ExactSizeIterator<Item = [f64; 3]> + Clone) -> LocalPlane {
    let count = points.len().max(1) as f64;
    let mean = points.clone().map(Vector3::from).sum::<Vector3<f64>>() / count;
    let spread: Matrix3<f64> = points.map(|p| Vector3::from(p) - mean).map(|d| d * d.transpose()).sum();
    let eigen = SymmetricEigen::new(spread);
    let least = eigen.eigenvalues.imin();
    let across = eigen.eigenvectors.column(least);
    let normal = DVec3::new(across[0], across[1], across[2]).try_normalize().unwrap_or(DVec3::Z);
    let normal = if normal.z < 0.0 { -normal } else { normal };
    let rms_m = (eigen.eigenvalues[least].max(0.0) / count).sqrt();
    LocalPlane { center: DVec3::new(mean.x, mean.y, mean.z), normal, rms_m }
}

/// The mean of the points of each voxel, in the order of the voxels.
pub fn voxel_means(points: &[[f64; 3]], side: f64) -> Vec<[f64; 3]> {
    let voxel = |p: &[f64; 3]| p.map(|v| (v / side).floor() as i64);
    let mut keyed: Vec<([i64; 3], [f64; 3])> = points.par_iter().map(|p| (voxel(p), *p)).collect();
    // By position within a voxel too, so that the order of the points does not change the sums.
    keyed.par_sort_unstable_by(|a, b| {
        a.0.cmp(&b.0).then_with(|| {
            let by_axis = |k: usize| a.1[k].total_cmp(&b.1[k]);
            by_axis(0).then(by_axis(1)).then(by_axis(2))
        })
    });
    let mean = |same: &[([i64; 3], [f64; 3])]| {
        std::array::from_fn(|k| same.iter().map(|(_, p)| p[k]).sum::<f64>() / same.len() as f64)
    };
    keyed.chunk_by(|a, b| a.0 == b.0).map(mean).collect()
}

/// The points without those that are much further from others than is usual where they are. The rule is that of statistical outlier
/// removal, by the median of a cell, so that thinly covered parts are not taken for outliers; points in nearly empty cells are
/// compared with all others.
fn without_outliers(points: &[[f64; 3]]) -> Result<Vec<[f64; 3]>, PredictError> {
    let few = || PredictError::FewPoints { found: points.len(), needed: FEWEST_POINTS };
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(points).map_err(|_| few())?;
    let distance = |p: &[f64; 3]| {
        let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(OUTLIER_POINTS).execute();
        near.iter().map(|n| n.distance.sqrt()).sum::<f64>() / near.len().saturating_sub(1).max(1) as f64
    };
    let distances: Vec<f64> = points.par_iter().map(distance).collect();
    let typical = quantile(distances.clone(), 0.5).ok_or_else(few)?;
    let side = CELL_M.max(CELL_SPACINGS * typical);
    let mut cells: BTreeMap<[i64; 2], Vec<f64>> = BTreeMap::new();
    for (p, d) in points.iter().zip(&distances) {
        cells.entry(cell(*p, side)).or_default().push(*d);
    }
    let limit = |distances: Vec<f64>| {
        let median = quantile(distances.clone(), 0.5)?;
        let mad = quantile(distances.iter().map(|d| (d - median).abs()).collect(), 0.5)?;
        Some((median + OUTLIER_DEVIATIONS * 1.4826 * mad).max(OUTLIER_FACTOR * median))
    };
    let of_all = limit(distances.clone()).ok_or_else(few)?;
    let of_cell = |own: Vec<f64>| if own.len() < OUTLIER_POINTS.get() { Some(of_all) } else { limit(own) };
    let limits: BTreeMap<[i64; 2], f64> =
        cells.into_iter().filter_map(|(cell, distances)| Some((cell, of_cell(distances)?))).collect();
    let is_near = |(p, d): &(&[f64; 3], &f64)| limits.get(&cell(**p, side)).is_none_or(|limit| *d <= limit);
    Ok(points.iter().zip(&distances).filter(is_near).map(|(p, _)| *p).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    fn slope(count: u64) -> Vec<[f64; 3]> {
        let point = |i| {
            let mut draw = CounterRng::new(5, 0, 0, i);
            let (x, y) = (40.0 * draw.uniform(), 40.0 * draw.uniform());
            [x, y, 0.5 * x + 0.02 * draw.normal()]
        };
        (0..count).map(point).collect()
    }

    #[test]
    fn points_far_from_a_surface_are_dropped_and_thinly_covered_parts_are_kept() {
        let mut points = slope(4000);
        // Thinly covered from a border of cells on.
        points.retain(|p| p[0] < 16.0 || (10.0 * p[1]).fract() < 0.1);
        let surface = points.len();
        points.extend(
            (0..40)
                .map(|i| [i, 7 * i % 40, 3 * (i % 5)].map(f64::from))
                .map(|[x, y, z]| [x, y, 0.5 * x + 9.0 + z]),
        );
        points.push([f64::NAN, 1.0, 1.0]);
        let (cloud, clean_up) = Cloud::new(&points, 0.1).unwrap();
        assert_eq!(clean_up.given, points.len());
        let far = cloud.positions().iter().filter(|p| p[2] - 0.5 * p[0] > 5.0).count();
        assert!(far <= 4, "{far} of 40 are left");
        assert!(clean_up.dropped < 41 + surface / 50, "{clean_up:?}");
    }

    #[test]
    fn planes_have_the_slope_of_the_surface_and_the_order_of_points_does_not_matter() {
        let mut points = slope(3000);
        let (cloud, _) = Cloud::new(&points, 0.25).unwrap();
        let expected = DVec3::new(-0.5, 0.0, 1.0).normalize();
        let off = cloud.planes().iter().filter(|plane| plane.normal.dot(expected) < 0.98).count();
        assert!(off < cloud.positions().len() / 50, "{off}");
        points.reverse();
        assert_eq!(Cloud::new(&points, 0.25).unwrap().0.positions(), cloud.positions());
    }

    #[test]
    fn too_few_points_are_an_error() {
        for points in [vec![], vec![[0.0; 3]], vec![[1.0; 3]; 1000], vec![[f64::NAN; 3]; 30]] {
            assert!(matches!(Cloud::new(&points, 0.5), Err(PredictError::FewPoints { .. })));
        }
    }
}
