//! Depths of a view from its priors of depths and of normals together, and the points that it sees.
//!
//! Depths that were aligned with points are right near these. On a wall without texture there are no points, and what is left is the
//! error of the network that estimated the depths. Normals carry depths across such a wall from its rim: on a plane with the normal
//! `n` the inverse depths at two rays `r` and `s` are as `n r` to `n s`.
//!
//! On a coarse grid of cells, let `x` be the logarithm of the depth divided by that of the aligned prior, with the inverse depths `w`. For
//! neighbouring cells `p` and `q`, `x_q - x_p` is about `ln (w_q (n r_p) / (w_p (n r_q)))`, as the mean for both normals `n`: if an edge of
//! two surfaces lies between them, each surface has half of the way. (The mean of the normals would follow the one that faces the camera
//! more, and bring walls too near that are seen behind a floor.) Where a depth is
//! known so is `x`; `x` is near 0 where points are near, from which the prior was corrected. (Without the logarithms the equations of
//! neighbours would be homogeneous, and noise of the normals would make all surfaces farther.) Neighbours between which the prior jumps
//! otherwise than the normals say are not compared.
//! The sum of squares, each divided by its variance, is minimised by conjugate gradients, and `x` is interpolated to the pixels.

use super::conjugate_gradients::{Limits, solve};
use super::hdd::AlignedDepth;
use super::hdd::field::mean_spacing;
use super::map::NormalPrior;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::stats::median;
use glam::{DVec2, DVec3};
use kiddo::{ImmutableKdTree, SquaredEuclidean};

/// Number of cells along the width of a view.
const CELLS: usize = 96;
/// Standard deviations, as shares of the depth: of the depth of a cell as the normals of it and its neighbour have it, and of the aligned
/// prior far from points, whose errors are the same across hundreds of cells.
const BY_NORMALS: f64 = 1e-3;
const BY_PRIOR: f64 = 0.5;
/// That of the aligned prior at a point, as a share of the error at points that were left out; it grows by the factor e within so
/// many mean spacings of points. It is not taken to be smaller than this.
const BESIDE_POINTS: f64 = 0.3;
const GROWS_WITHIN: f64 = 0.5;
const LEAST_BY_PRIOR: f64 = 1e-3;
/// Depths of neighbouring cells that differ by more than this share from what the normal says belong to two surfaces.
const EDGE: f64 = 0.04;
/// Cells whose depth differs by less than this share from that of a pixel correct it.
const SAME_DEPTH: f64 = 0.1;
/// Known depths farther off than this many standard deviations get less weight (Huber), in so many rounds.
const HUBER: f64 = 2.0;
const ROUNDS: usize = 3;
/// When conjugate gradients end.
const LIMITS: Limits = Limits { steps: 600, residual: 1e-7 };

/// A place of a view, 0 at the centre of the first pixel, whose depth is known.
#[derive(Clone, Copy)]
pub(super) struct KnownDepth {
    pub col: f64,
    pub row: f64,
    pub depth: f64,
    /// Standard deviation, as a share of the depth.
    pub deviation: f64,
    /// Sum of the unit normals that other views have there, in camera axes; zero if there are none.
    pub normals: DVec3,
}

/// A view whose aligned depths can be brought to normals and known depths.
pub(super) struct Integration {
    /// The aligned depths.
    pub aligned: Grid2,
    /// Standard deviations of the cells' aligned depths, as shares of the depth.
    deviations: Vec<f64>,
    cells: Cells,
}

impl Integration {
    pub fn new(aligned: AlignedDepth, normals: &NormalPrior, camera: &PinholeCamera) -> Self {
        let side = aligned.depth.width.div_ceil(CELLS).max(1);
        let cells = Cells::new(&aligned.depth, normals, side, camera);
        let deviations = cells.deviations(&aligned);
        Self { aligned: aligned.depth, deviations, cells }
    }

    /// The normal of most pixels of a cell, in camera axes; NaN where there is none.
    pub fn normal(&self, cell: usize) -> DVec3 {
        self.cells.normals[cell]
    }

    /// Side of the cells of the coarse grid, pixels.
    pub fn side(&self) -> usize {
        self.cells.side
    }

    /// Depths that agree with the normals and the known depths; cells without a normal keep the aligned ones unless a known depth is
    /// near.
    pub fn depths(&self, known_depths: &[KnownDepth]) -> Grid2 {
        let Self { aligned, deviations, cells } = self;
        let links = cells.links(&cells.normals_with(known_depths));
        let known = |p: &KnownDepth| {
            let cell = cells.cell_of(p.col, p.row)?;
            let from = f64::from(aligned.get(p.col.round() as i64, p.row.round() as i64));
            Some((cell, (p.depth / from).ln(), p.deviation)).filter(|(_, x, _)| x.is_finite())
        };
        let known: Vec<(usize, f64, f64)> = known_depths.iter().filter_map(known).collect();
        let mut weights: Vec<f64> = known.iter().map(|k| k.2.powi(-2)).collect();
        let mut x = vec![0.0; cells.inverse.len()];
        for _ in 0..ROUNDS {
            let mut system = System::new(deviations, &links);
            for ((cell, value, _), weight) in known.iter().zip(&weights) {
                system.diagonal[*cell] += weight;
                system.right[*cell] += weight * value;
            }
            system.solve(&mut x);
            for ((cell, value, deviation), weight) in known.iter().zip(&mut weights) {
                let deviations = (x[*cell] - value).abs() / deviation;
                *weight = deviation.powi(-2) * (HUBER / deviations.max(HUBER));
            }
        }
        Grid2::from_fn(aligned.width, aligned.height, |col, row| {
            let depth =
                aligned.at(col, row) * cells.interpolated(&x, col, row, aligned.at(col, row)).exp() as f32;
            if depth > 0.0 { depth } else { f32::NAN }
        })
    }
}

/// The view in cells, row by row.
struct Cells {
    width: usize,
    height: usize,
    side: usize,
    /// Median inverse depths of the aligned prior; NaN where it has none.
    inverse: Vec<f64>,
    /// Normals of most of their pixels; NaN where there are none.
    normals: Vec<DVec3>,
    /// Rays through their centres, at depth one.
    rays: Vec<DVec3>,
}

/// Two cells, and by how much `x` of the second one is greater.
struct Link {
    cells: [usize; 2],
    difference: f64,
}

impl Cells {
    fn new(aligned: &Grid2, normals: &NormalPrior, side: usize, camera: &PinholeCamera) -> Self {
        let (width, height) = (aligned.width.div_ceil(side), aligned.height.div_ceil(side));
        let pixels = |cell: usize| {
            let (col, row) = (cell % width * side, cell / width * side);
            let cols = col..(col + side).min(aligned.width);
            (row..(row + side).min(aligned.height))
                .flat_map(move |row| cols.clone().map(move |col| (col, row)))
        };
        let inverse = |cell: usize| {
            let depths = pixels(cell).map(|(col, row)| f64::from(aligned.at(col, row)));
            median(depths.filter(|z| *z > 0.0).collect()).map_or(f64::NAN, f64::recip)
        };
        let normal = |cell: usize| {
            let normals = pixels(cell)
                .map(|at| DVec3::from_array(normals.planes.each_ref().map(|p| f64::from(p.at(at.0, at.1)))));
            // Of a cell across an edge of two surfaces, medians are the normal of the one that has more of it.
            let normals: Vec<DVec3> = normals.filter(|n| n.is_finite()).collect();
            let along = |axis: usize| median(normals.iter().map(|n| n[axis]).collect()).unwrap_or(f64::NAN);
            DVec3::from_array([0, 1, 2].map(along)).try_normalize().unwrap_or(DVec3::NAN)
        };
        let ray = |cell: usize| ((middle(cell, width, side) - camera.principal) / camera.focal).extend(1.0);
        let cells = 0..width * height;
        Self {
            width,
            height,
            side,
            inverse: cells.clone().map(inverse).collect(),
            normals: cells.clone().map(normal).collect(),
            rays: cells.map(ray).collect(),
        }
    }

    /// The standard deviations of the cells' aligned depths, as shares of the depth.
    fn deviations(&self, aligned: &AlignedDepth) -> Vec<f64> {
        let AlignedDepth { depth, places, .. } = aligned;
        let tree = ImmutableKdTree::<f64, 2>::new_from_slice(places).ok();
        let Some(tree) = tree.filter(|_| !places.is_empty()) else {
            return vec![BY_PRIOR; self.inverse.len()];
        };
        let spacing = mean_spacing((depth.width, depth.height), places.len());
        let beside = (BESIDE_POINTS * aligned.quality.local).max(f64::EPSILON);
        let deviation = |cell: usize| {
            let middle = middle(cell, self.width, self.side).to_array();
            let distance =
                tree.query(&middle).nearest_one::<SquaredEuclidean<f64>>().execute().distance.sqrt();
            (beside * (distance / (GROWS_WITHIN * spacing)).exp()).clamp(LEAST_BY_PRIOR, BY_PRIOR)
        };
        (0..self.inverse.len()).map(deviation).collect()
    }

    /// The values `x` of the cells around a pixel of this depth, mixed by their nearness; only of cells of about this depth, if there
    /// are any, so that a correction stays on its surface.
    fn interpolated(&self, x: &[f64], col: usize, row: usize, depth: f32) -> f64 {
        let place = |pixel: usize, cells: usize| {
            let at = (pixel as f64 + 0.5) / self.side as f64 - 0.5;
            at.clamp(0.0, cells as f64 - 1.0)
        };
        let (u, v) = (place(col, self.width), place(row, self.height));
        let around = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)].map(|(dc, dr)| {
            let (c, r) = (
                (u.floor() + dc).min(self.width as f64 - 1.0),
                (v.floor() + dr).min(self.height as f64 - 1.0),
            );
            let share = (1.0 - (c - u).abs()).max(0.0) * (1.0 - (r - v).abs()).max(0.0);
            (r as usize * self.width + c as usize, share)
        });
        let mixed = |of_this_depth: bool| {
            let cells = around.iter().filter(|(cell, _)| {
                !of_this_depth || (self.inverse[*cell] * f64::from(depth) - 1.0).abs() < SAME_DEPTH
            });
            cells.fold((0.0, 0.0), |(sum, shares), (cell, share)| (sum + share * x[*cell], shares + share))
        };
        let (sum, shares) = Some(mixed(true)).filter(|m| m.1 > 0.0).unwrap_or_else(|| mixed(false));
        sum / shares
    }

    fn cell_of(&self, col: f64, row: f64) -> Option<usize> {
        let [col, row] = [col, row].map(|at| (at + 0.5) / self.side as f64);
        let is_inside = col >= 0.0 && row >= 0.0 && col < self.width as f64 && row < self.height as f64;
        let cell = row as usize * self.width + col as usize;
        (is_inside && self.inverse[cell].is_finite()).then_some(cell)
    }

    /// The means of the own normals and those of other views, whose errors are others; NaN where there are none.
    fn normals_with(&self, known: &[KnownDepth]) -> Vec<DVec3> {
        let mut normals = self.normals.clone();
        for known in known {
            if let Some(cell) = self.cell_of(known.col, known.row) {
                normals[cell] += known.normals;
            }
        }
        normals.iter_mut().for_each(|n| *n = n.try_normalize().unwrap_or(DVec3::NAN));
        normals
    }

    /// The neighbours that lie on one surface, by the normals of the cells.
    fn links(&self, normals: &[DVec3]) -> Vec<Link> {
        let link = |p: usize, q: usize| {
            let by_normal = |normal: DVec3| {
                let [at_p, at_q] = [p, q].map(|cell| normal.dot(self.rays[cell]));
                // Not a number if the normal faces away from a ray, or if there is none.
                if at_p < 0.0 { (at_p / at_q).ln() } else { f64::NAN }
            };
            let by_prior = (self.inverse[p] / self.inverse[q]).ln();
            let difference = 0.5 * (by_normal(normals[p]) + by_normal(normals[q])) - by_prior;
            // False for NaN too.
            (difference.abs() < EDGE).then_some(Link { cells: [p, q], difference })
        };
        let right = (0..self.inverse.len()).filter(|p| (p + 1) % self.width != 0).map(|p| (p, p + 1));
        let below = (0..self.inverse.len().saturating_sub(self.width)).map(|p| (p, p + self.width));
        right.chain(below).filter_map(|(p, q)| link(p, q)).collect()
    }
}

/// The place in the middle of a cell, pixels; of cells row by row.
fn middle(cell: usize, cells_wide: usize, side: usize) -> DVec2 {
    let first = DVec2::new((cell % cells_wide) as f64, (cell / cells_wide) as f64) * side as f64;
    first + 0.5 * (side as f64 - 1.0)
}

/// The normal equations: a symmetric positive definite matrix, as its diagonal and the links between cells.
struct System<'a> {
    links: &'a [Link],
    diagonal: Vec<f64>,
    right: Vec<f64>,
}

impl<'a> System<'a> {
    /// Of the links and the prior.
    fn new(deviations: &[f64], links: &'a [Link]) -> Self {
        let mut diagonal: Vec<f64> = deviations.iter().map(|deviation| deviation.powi(-2)).collect();
        let mut right = vec![0.0; deviations.len()];
        for Link { cells: [p, q], difference } in links {
            for (cell, sign) in [(*p, -1.0), (*q, 1.0)] {
                diagonal[cell] += BY_NORMALS.powi(-2);
                right[cell] += sign * difference * BY_NORMALS.powi(-2);
            }
        }
        Self { links, diagonal, right }
    }

    /// Improves `x`.
    fn solve(&self, x: &mut [f64]) {
        let product = |x: &[f64], out: &mut Vec<f64>| {
            out.clear();
            out.extend(x.iter().zip(&self.diagonal).map(|(x, d)| x * d));
            for Link { cells: [p, q], .. } in self.links {
                out[*p] -= BY_NORMALS.powi(-2) * x[*q];
                out[*q] -= BY_NORMALS.powi(-2) * x[*p];
            }
        };
        solve(product, &self.diagonal, &self.right, x, &LIMITS);
    }
}

#[cfg(test)]
mod tests {
    use super::super::hdd::AlignmentQuality;
    use super::*;
    use crate::random::CounterRng;
    use crate::stats::quantile;
    use glam::DMat3;

    const SIZE: (usize, usize) = (192, 144);

    fn camera() -> PinholeCamera {
        PinholeCamera {
            cam_from_site: DMat3::IDENTITY,
            center: DVec3::ZERO,
            focal: DVec2::splat(130.0),
            principal: DVec2::new(95.5, 71.5),
            size: SIZE,
        }
    }

    /// Depth and normal of a corner of two walls with a box before it.
    fn surface(col: usize, row: usize) -> (f64, DVec3) {
        let ray = ((DVec2::new(col as f64, row as f64) - camera().principal) / 130.0).extend(1.0);
        let hit = |normal: DVec3, offset: f64| (offset / normal.dot(ray), normal);
        let walls = [hit(DVec3::new(-0.6, 0.0, -0.8), -3.0), hit(DVec3::new(0.8, 0.0, -0.6), -2.5)];
        let wall = walls.into_iter().filter(|w| w.0 > 0.0).min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
        if (60..100).contains(&col) && (90..130).contains(&row) { (1.5, -DVec3::Z) } else { wall }
    }

    #[test]
    fn normals_carry_the_depths_of_points_at_the_rim_across_walls() {
        let mut draw = CounterRng::new(2, 0, 0, 0);
        // The prior is off by up to 8 % in the middle of the walls.
        let warp = |col: usize, row: usize| {
            1.0 + 0.08 * (col as f64 / 30.0).sin() * (std::f64::consts::PI * row as f64 / SIZE.1 as f64).sin()
        };
        let aligned =
            Grid2::from_fn(SIZE.0, SIZE.1, |col, row| (surface(col, row).0 * warp(col, row)) as f32);
        let mut planes = [(); 3].map(|()| Grid2::filled(SIZE.0, SIZE.1, 0.0));
        for i in 0..SIZE.0 * SIZE.1 {
            let noise = DVec3::from_array(std::array::from_fn(|_| 0.12 * draw.normal()));
            let normal = (surface(i % SIZE.0, i / SIZE.0).1 + noise).normalize().to_array();
            planes.iter_mut().zip(normal).for_each(|(plane, v)| plane.data[i] = v as f32);
        }
        // Points near the upper and lower margin, and on the box; every tenth is wrong.
        let point = |index: usize| {
            let mut draw = CounterRng::new(3, 0, 0, index as u64);
            let col = draw.below(SIZE.0);
            let row = if index.is_multiple_of(2) { draw.below(8) } else { SIZE.1 - 1 - draw.below(8) };
            let (col, row) =
                if index.is_multiple_of(5) { (62 + draw.below(36), 92 + draw.below(36)) } else { (col, row) };
            let error = if index % 10 == 3 { 1.3 } else { 1.0 + 0.003 * draw.normal() };
            let depth = surface(col, row).0 * error;
            KnownDepth { col: col as f64, row: row as f64, depth, deviation: 0.004, normals: DVec3::ZERO }
        };
        let points: Vec<KnownDepth> = (0..150).map(point).collect();
        let without_points = AlignedDepth::without_points(aligned.clone());
        let found =
            Integration::new(without_points.clone(), &NormalPrior { planes }, &camera()).depths(&points);
        let errors = |depths: &Grid2| {
            let off = |i: usize| {
                let exact = surface(i % SIZE.0, i / SIZE.0).0;
                (f64::from(depths.data[i]) / exact - 1.0).abs()
            };
            let all: Vec<f64> = (0..depths.data.len()).map(off).collect();
            [0.5, 0.95].map(|q| quantile(all.clone(), q).unwrap())
        };
        let (before, after) = (errors(&aligned), errors(&found));
        assert!(
            after[0] < 0.25 * before[0] && after[1] < 0.4 * before[1],
            "{before:?} before, {after:?} after"
        );
        let share = |i: usize| f64::from(found.data[i]) / surface(i % SIZE.0, i / SIZE.0).0 - 1.0;
        let bias = quantile((0..found.data.len()).map(share).collect(), 0.5).unwrap();
        assert!(bias.abs() < 0.003, "noise of normals makes surfaces neither nearer nor farther: {bias}");
        // Without points the prior keeps its scale; without normals its depths.
        let unknown = NormalPrior { planes: [(); 3].map(|()| Grid2::filled(SIZE.0, SIZE.1, f32::NAN)) };
        let without = Integration::new(without_points, &unknown, &camera());
        assert_eq!(without.depths(&[]), aligned);
    }

    #[test]
    fn a_wall_behind_a_floor_that_is_seen_at_a_grazing_angle_is_not_too_near() {
        // The floor is 1 m below the camera, the wall about 4 m away and turned, so that their edge crosses cells at all places.
        let (down, wall) = (DVec3::NEG_Y, DVec3::new(-0.3, 0.0, -0.95).normalize());
        let surface = |col: usize, row: usize| {
            let ray = ((DVec2::new(col as f64, row as f64) - camera().principal) / 130.0).extend(1.0);
            let (floor, back) = (-1.0 / down.dot(ray), -4.0 / wall.dot(ray));
            if floor > 0.0 && floor < back { (floor, down) } else { (back, wall) }
        };
        let is_wall = |i: &usize| surface(i % SIZE.0, i / SIZE.0).1 == wall;
        // The prior has the wall too far, by 10 % at the upper margin.
        let off = |row: usize| 1.0 + 0.1 * (1.0 - row as f64 / 100.0).max(0.0);
        let aligned = Grid2::from_fn(SIZE.0, SIZE.1, |col, row| (surface(col, row).0 * off(row)) as f32);
        let normal =
            |axis: usize| Grid2::from_fn(SIZE.0, SIZE.1, |col, row| surface(col, row).1[axis] as f32);
        let normals = NormalPrior { planes: [0, 1, 2].map(normal) };
        let point = |i: usize| {
            let (col, row) = (i % SIZE.0, i / SIZE.0);
            let depth = surface(col, row).0;
            KnownDepth { col: col as f64, row: row as f64, depth, deviation: 3e-3, normals: DVec3::ZERO }
        };
        let points: Vec<KnownDepth> =
            (0..SIZE.0 * SIZE.1).step_by(7).filter(|i| !is_wall(i)).map(point).collect();
        let found =
            Integration::new(AlignedDepth::without_points(aligned), &normals, &camera()).depths(&points);
        let share = |i: usize| f64::from(found.data[i]) / surface(i % SIZE.0, i / SIZE.0).0 - 1.0;
        let bias = median((0..found.data.len()).filter(is_wall).map(share).collect()).unwrap();
        // Half a cell at the edge is 1.5 %.
        assert!(bias.abs() < 0.01, "{bias}");
    }

    #[test]
    fn depths_near_points_stay_as_they_were_aligned_with_these() {
        let aligned = Grid2::filled(SIZE.0, SIZE.1, 2.0);
        let places: Vec<[f64; 2]> =
            (0..400).map(|k| [2.0 + 4.0 * f64::from(k % 20), 3.5 + 7.0 * f64::from(k / 20)]).collect();
        let is_near = |col: usize| col < 78;
        // Normals that turn the wall by 10 degrees.
        let turned = DVec3::new(0.17, 0.0, -0.98).to_array();
        let normals = NormalPrior { planes: turned.map(|v| Grid2::filled(SIZE.0, SIZE.1, v as f32)) };
        let quality = AlignmentQuality { points: 400, global: 0.02, local: 3e-3 };
        let aligned = AlignedDepth { places, quality, ..AlignedDepth::without_points(aligned) };
        let found = Integration::new(aligned, &normals, &camera()).depths(&[]);
        let off = |near: bool| {
            let of_column = (0..SIZE.0).filter(|col| is_near(*col) == near);
            of_column.map(|col| f64::from(found.at(col, 70) / 2.0 - 1.0).abs()).fold(0.0, f64::max)
        };
        assert!(off(true) < 0.03, "{}", off(true));
        assert!(off(false) > 0.1, "{}", off(false));
    }
}
