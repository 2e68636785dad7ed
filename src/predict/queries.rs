//! Densification: the positions that splats are predicted at (Point2GS §3.2).
//!
//! Occupied voxels of the cloud are sampled where the lines of a regular grid along the axis that the surface faces most meet it.
//! The surface is the mean of the planes around the nearest points (moving least squares). Clouds of satellites have
//! no points on walls; where neighbouring columns differ in height, voxels are added from the upper to the lower one.

use super::{Cloud, SplatSampling, is_within};
use crate::frame::SiteBox;
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::num::NonZero;

/// Side of a voxel, in spacings of the points: nearly every voxel of a surface then has a point.
const VOXEL_SPACINGS: f64 = 2.0;
/// A sample whose place on the surface is further outside of its voxel, in sides, belongs to another.
const OUTSIDE: f64 = 0.5;
/// Passes that find where a line meets the surface.
const PASSES: usize = 3;
/// A line meets no surface whose unit normal has a smaller component along it.
const GRAZING: f64 = 0.3;
/// Number of points whose planes are averaged.
const PLANES: NonZero<usize> = NonZero::new(4).unwrap();
/// Neighbouring columns that differ by more have a wall between them, metres.
const WALL_M: f64 = 2.0;
/// Columns of more than this side are too wide to tell where a wall is, metres.
const WIDEST_COLUMN_M: f64 = 4.0;

/// A position at which a splat is predicted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Query {
    /// The position.
    pub position: [f64; 3],
    /// Unit normal of the surface, upwards; of walls towards the lower side.
    pub normal: [f64; 3],
    /// Root mean square distance of the points around from their plane, metres.
    pub rms_m: f64,
    /// Distance from where the line was begun to be followed, the middle of the points of the voxel, metres.
    pub moved_m: f64,
    /// Index of the nearest point of the cloud, and its distance, metres.
    pub nearest: (usize, f64),
    /// Whether it lies on a wall without points.
    pub is_wall: bool,
}

/// A voxel, by its index along each axis.
type Voxel = [i64; 3];

/// Side of the voxels of a cloud, metres.
#[must_use]
pub fn voxel_m(cloud: &Cloud, sampling: &SplatSampling) -> f64 {
    // A whole number of samples along each side.
    let sides = (VOXEL_SPACINGS * cloud.spacing_m() / sampling.spacing_m).round().max(2.0);
    sides * sampling.spacing_m
}

/// The queries in a level box (west, south, east, north), metres. `has_walls` adds those of walls without points.
#[must_use]
pub fn queries(cloud: &Cloud, sampling: &SplatSampling, area: SiteBox, has_walls: bool) -> Vec<Query> {
    let side = voxel_m(cloud, sampling);
    let voxel = |p: [f64; 3]| p.map(|v| (v / side).floor() as i64);
    // Samples move by less than a voxel.
    let is_near = |p: &[f64; 3]| is_within(area, 2.0 * side, *p);
    let near = cloud.positions().iter().zip(cloud.planes()).filter(|(p, _)| is_near(p));
    let mut occupied: BTreeMap<Voxel, VoxelPoints> = BTreeMap::new();
    near.clone().for_each(|(p, plane)| occupied.entry(voxel(*p)).or_default().add(*p, plane.normal));
    let is_inside = |q: &Query| is_within(area, 0.0, q.position);
    let samples = (side / sampling.spacing_m).round() as i64;
    let of_voxel = |(at, points): (&Voxel, &VoxelPoints)| {
        let own = points.lines(*at, side, samples).filter_map(|(axis, start)| {
            let query = on_line(cloud, axis, start)?;
            let to = voxel(query.position);
            let is_own = to == *at || !occupied.contains_key(&to) && is_beside(query.position, *at, side);
            (is_own && is_inside(&query)).then_some(query)
        });
        own.collect::<Vec<_>>()
    };
    let mut out: Vec<Query> = occupied.par_iter().flat_map_iter(of_voxel).collect();
    if has_walls && side <= WIDEST_COLUMN_M {
        let walls = wall_voxels(&near.map(|(p, _)| *p).collect::<Vec<_>>(), side);
        let walls = walls.into_iter().filter(|(at, _)| !occupied.contains_key(at));
        let of_wall = |(at, normal): (Voxel, DVec3)| {
            pattern(at, side, samples).into_iter().map(move |p| on_wall(cloud, p, normal)).filter(is_inside)
        };
        let walls: Vec<(Voxel, DVec3)> = walls.collect();
        out.extend(walls.into_par_iter().flat_map_iter(of_wall).collect::<Vec<_>>());
    }
    out
}

/// The queries at these positions themselves.
#[must_use]
pub fn queries_at(cloud: &Cloud, positions: &[[f64; 3]]) -> Vec<Query> {
    positions.iter().map(|p| Query { position: *p, moved_m: 0.0, ..on_surface(cloud, *p) }).collect()
}

/// What the points of a voxel tell of its surface.
#[derive(Default)]
struct VoxelPoints {
    count: f64,
    sum: DVec3,
    /// Sum of the absolute components of the normals.
    facing: DVec3,
}

impl VoxelPoints {
    fn add(&mut self, p: [f64; 3], normal: DVec3) {
        self.count += 1.0;
        self.sum += DVec3::from_array(p);
        self.facing += normal.abs();
    }

    /// `samples` times `samples` lines of a regular grid through the voxel along the axis that the surface faces most: the axis and
    /// the point of the line in the middle of the points.
    fn lines(&self, at: Voxel, side: f64, samples: i64) -> impl Iterator<Item = (usize, [f64; 3])> {
        let axis = (0..3).max_by(|a, b| self.facing[*a].total_cmp(&self.facing[*b])).unwrap_or(2);
        let start = self.sum / self.count;
        let place = move |k: usize, i: i64| side * (at[k] as f64 + (i as f64 + 0.5) / samples as f64);
        let line = move |i: i64, j: i64| {
            let mut p = start.to_array();
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            (p[u], p[v]) = (place(u, i), place(v, j));
            (axis, p)
        };
        (0..samples).flat_map(move |i| (0..samples).map(move |j| line(i, j)))
    }
}

/// `samples` times `samples` positions in a voxel, of which each pair of coordinates takes every value of a regular grid once.
fn pattern(at: Voxel, side: f64, samples: i64) -> Vec<[f64; 3]> {
    let place = |axis: usize, i: i64| side * (at[axis] as f64 + (i as f64 + 0.5) / samples as f64);
    let position = |i: i64, j: i64| [place(0, i), place(1, j), place(2, (i + j) % samples)];
    (0..samples).flat_map(|i| (0..samples).map(move |j| position(i, j))).collect()
}

/// Whether a position lies in a voxel or not far outside of it.
fn is_beside(p: [f64; 3], at: Voxel, side: f64) -> bool {
    (0..3).all(|k| {
        let from = p[k] / side - at[k] as f64;
        (-OUTSIDE..1.0 + OUTSIDE).contains(&from)
    })
}

/// Where a line along an axis meets the surface, searched from a point of it; none if the surface is along the line.
fn on_line(cloud: &Cloud, axis: usize, start: [f64; 3]) -> Option<Query> {
    let mut p = start;
    for _ in 0..PASSES {
        let query = on_surface(cloud, p);
        let normal = DVec3::from_array(query.normal);
        let along = normal[axis];
        if along.abs() < GRAZING {
            return None;
        }
        p[axis] += normal.dot(DVec3::from_array(query.position) - DVec3::from_array(p)) / along;
    }
    Some(Query { position: p, moved_m: (p[axis] - start[axis]).abs(), ..on_surface(cloud, p) })
}

/// A sample moved onto the surface.
fn on_surface(cloud: &Cloud, p: [f64; 3]) -> Query {
    let from = DVec3::from_array(p);
    let near: Vec<(usize, f64)> = cloud.nearest(p, PLANES).collect();
    let nearest = near[0];
    let least = 1e-4 * cloud.spacing_m() * cloud.spacing_m();
    let (mut sum, mut normal, mut rms_m, mut weights) = (DVec3::ZERO, DVec3::ZERO, 0.0, 0.0);
    for (index, squared) in near {
        let plane = &cloud.planes()[index];
        let weight = (squared + least).powi(-2);
        sum += weight * plane.nearest(from);
        normal += weight * plane.normal;
        rms_m += weight * plane.rms_m;
        weights += weight;
    }
    let position = sum / weights;
    Query {
        position: position.to_array(),
        normal: normal.try_normalize().unwrap_or(DVec3::Z).to_array(),
        rms_m: rms_m / weights,
        moved_m: position.distance(from),
        nearest: (nearest.0, nearest.1.sqrt()),
        is_wall: false,
    }
}

/// A sample of a wall.
fn on_wall(cloud: &Cloud, p: [f64; 3], normal: DVec3) -> Query {
    Query { position: p, normal: normal.to_array(), moved_m: 0.0, is_wall: true, ..on_surface(cloud, p) }
}

/// The voxels of walls between neighbouring columns of different heights, in the upper column, with the level direction to the
/// lower one.
fn wall_voxels(points: &[[f64; 3]], side: f64) -> BTreeMap<Voxel, DVec3> {
    let mut tops: BTreeMap<[i64; 2], f64> = BTreeMap::new();
    for p in points {
        let top = tops.entry([p[0], p[1]].map(|v| (v / side).floor() as i64)).or_insert(f64::NEG_INFINITY);
        *top = top.max(p[2]);
    }
    let mut out = BTreeMap::new();
    for ([x, y], top) in &tops {
        let mut normal = DVec3::ZERO;
        let mut lowest = *top;
        for (dx, dy) in [(1, 0), (0, 1), (-1, 0), (0, -1)] {
            let Some(beside) = tops.get(&[x + dx, y + dy]).filter(|beside| top - **beside > WALL_M) else {
                continue;
            };
            lowest = lowest.min(*beside);
            normal += DVec3::new(dx as f64, dy as f64, 0.0);
        }
        if lowest < *top {
            let normal = normal.try_normalize().unwrap_or(DVec3::Z);
            let index = |z: f64| (z / side).floor() as i64;
            out.extend((index(lowest)..index(*top)).map(|z| ([*x, *y, z], normal)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    /// A block of 10 m x 10 m and 8 m high on a slope, a point every half metre.
    fn block() -> Cloud {
        let point = |i: i32| {
            let (x, y) = (f64::from(i % 60) * 0.5 + 0.25, f64::from(i / 60) * 0.5 + 0.25);
            let is_roof = (10.0..20.0).contains(&x) && (10.0..20.0).contains(&y);
            [x, y, if is_roof { 12.0 } else { 0.1 * x }]
        };
        Cloud::new(&(0..3600).map(point).collect::<Vec<_>>(), 0.25).unwrap().0
    }

    #[test]
    fn samples_lie_on_the_surface_at_the_asked_spacing() {
        let found = queries(&block(), &SplatSampling::default(), (2.0, 2.0, 8.0, 8.0), true);
        assert!((130..=160).contains(&found.len()), "{} on 36 square metres at half a metre", found.len());
        for q in &found {
            assert!((q.position[2] - 0.1 * q.position[0]).abs() < 0.02, "{q:?}");
            assert!(!q.is_wall && q.normal[2] > 0.98);
        }
    }

    #[test]
    fn walls_are_filled_from_the_roof_to_the_ground() {
        let found = queries(&block(), &SplatSampling::default(), (8.0, 12.0, 12.0, 18.0), true);
        let walls: Vec<&Query> = found.iter().filter(|q| q.is_wall).collect();
        assert!(walls.iter().all(|q| q.normal[0] < -0.9 && (10.0..11.0).contains(&q.position[0])));
        for z in [2.0, 5.0, 8.0, 11.0] {
            let level = walls.iter().filter(|q| (q.position[2] - z).abs() <= 0.5).count();
            assert!(level >= 10, "{level} at {z} m");
        }
        let without = queries(&block(), &SplatSampling::default(), (8.0, 12.0, 12.0, 18.0), false);
        assert!(without.iter().all(|q| !q.is_wall));
    }

    #[test]
    fn oblique_surfaces_are_sampled_without_gaps_and_not_much_too_densely() {
        for normal in
            [[0.5, 0.0, 0.87], [0.7, 0.1, 0.7], [0.87, 0.0, 0.5], [0.6, 0.55, 0.58], [0.1, 0.98, 0.15]]
        {
            let normal = DVec3::from_array(normal).normalize();
            let u = normal.any_orthonormal_vector();
            let v = normal.cross(u);
            let place = |a: f64, b: f64| (20.0 * DVec3::ONE + a * u + b * v).to_array();
            let points =
                (0..60 * 60).map(|i| place(0.5 * f64::from(i % 60 - 30), 0.5 * f64::from(i / 60 - 30)));
            let (cloud, _) = Cloud::new(&points.collect::<Vec<_>>(), 0.1).unwrap();
            let found = queries(&cloud, &SplatSampling::default(), (-50.0, -50.0, 90.0, 90.0), false);
            let is_near = |p: [f64; 3], within: f64| {
                found.iter().any(|q| DVec3::from_array(q.position).distance(DVec3::from_array(p)) < within)
            };
            for i in 0..400 {
                let p = place(f64::from(i % 20) - 9.9, f64::from(i / 20) - 9.7);
                assert!(is_near(p, 0.65), "{normal}: no sample near {p:?}");
            }
            // Half a metre apart there would be 3600.
            assert!((1700..4500).contains(&found.len()), "{normal}: {} samples", found.len());
        }
    }

    #[test]
    fn few_points_still_cover_the_ground() {
        let all = block();
        let few: Vec<[f64; 3]> = all.positions().iter().copied().step_by(23).collect();
        let (cloud, _) = Cloud::new(&few, 0.25).unwrap();
        let found = queries(&cloud, &SplatSampling::default(), (1.0, 1.0, 29.0, 9.0), true);
        let cells: BTreeSet<[i64; 2]> =
            found.iter().map(|q| [q.position[0], q.position[1]].map(|v| v.floor() as i64)).collect();
        assert!(cells.len() > 28 * 8 * 9 / 10, "{} of {} cells", cells.len(), 28 * 8);
    }
}
