//! The views' altitude maps as one surface on the map grid.

use super::Partners;
use super::maps::AltitudeMap;
use crate::affine::AffineCamera;
use crate::frame::{Pixel, Point};
use crate::io::{Grid2, MapGrid};
use crate::mvs::{MatchedSurface, PlaneSweep};
use rayon::prelude::*;

/// Gaps between cells of a surface that the map's pixels have left, cells, and the difference they bridge, of a step.
const GAP: i64 = 2;
const GAP_STEP: f32 = 2.0 / 3.0;
/// How far away the cells may lie that others are filled from, metres.
const FILL_M: f64 = 40.0;
/// Which of the values in eight directions fills a cell, from the lowest: what is hidden lies below what hides it
/// (Hirschmüller 2008, §2.6.3).
const FILL_RANK: usize = 1;
/// Directions of the eight in which there must be one: nothing is filled beyond the margins of what is known.
const FILL_DIRECTIONS: usize = 5;
const DIRECTIONS: [(i64, i64); 8] = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)];

/// Altitudes and scores on the grid.
type DrawnMap = (Grid2, Grid2);

/// The surface: in every cell the median of the views' maps; what they do not know filled from around, with a score of 0.
pub(super) fn surface(sweep: &PlaneSweep, partners: &[Partners], maps: &[AltitudeMap]) -> MatchedSurface {
    let PlaneSweep { site, grid, images, .. } = sweep;
    let draw = |(own, map): (&Partners, &AltitudeMap)| {
        let mut mesh = Mesh::new(grid, site.origin.xyz(), own.step_m);
        mesh.draw(&images[own.view].camera, map);
        (mesh.altitude, mesh.score)
    };
    let drawn: Vec<DrawnMap> = partners.par_iter().zip(maps).map(draw).collect();
    let step_m = partners.iter().fold(0.0, |most: f32, p| most.max(p.step_m));
    let middle = |i: usize| {
        let mut known: Vec<(f32, f32)> = drawn.iter().map(|(z, s)| (z.data[i], s.data[i])).collect();
        known.retain(|(z, _)| !z.is_nan());
        known.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let (Some(low), Some(high)) =
            (known.get(known.len().saturating_sub(1) / 2), known.get(known.len() / 2))
        else {
            return (f32::NAN, 0.0);
        };
        // Windows fatten what stands out: of two altitudes at its edge the lower one is right.
        let z = if high.0 - low.0 <= step_m { 0.5 * (low.0 + high.0) } else { low.0 };
        (z, 0.5 * (low.1 + high.1))
    };
    let (altitude, score) = (0..grid.width * grid.height).into_par_iter().map(middle).unzip();
    let plane = |data| Grid2 { width: grid.width, height: grid.height, data };
    let (mut altitude, mut score) = (plane(altitude), plane(score));
    close_gaps(&mut altitude, &mut score, GAP_STEP * step_m);
    fill(sweep, &mut altitude, &mut score);
    // Nothing but this surface tells training where what two views see lies.
    let prior_weight =
        Grid2::from_fn(grid.width, grid.height, |col, row| f32::from(!altitude.at(col, row).is_nan()));
    MatchedSurface { site: *site, grid: *grid, altitude, score, prior_weight }
}

/// A map as a mesh seen from above: in every cell the highest triangle.
struct Mesh<'a> {
    grid: &'a MapGrid,
    /// Easting and northing of the site's origin.
    origin: [f64; 2],
    /// Triangles that climb more hang over a step, metres.
    step_m: f32,
    altitude: Grid2,
    score: Grid2,
}

impl<'a> Mesh<'a> {
    fn new(grid: &'a MapGrid, [east, north, _]: [f64; 3], step_m: f32) -> Self {
        Self {
            grid,
            origin: [east, north],
            step_m,
            altitude: Grid2::filled(grid.width, grid.height, f32::NAN),
            score: Grid2::filled(grid.width, grid.height, 0.0),
        }
    }

    /// Draws two triangles for every four neighbouring pixels.
    fn draw(&mut self, camera: &AffineCamera, map: &AltitudeMap) {
        for row in 0..map.altitude.height - 1 {
            for col in 0..map.altitude.width - 1 {
                let corners = [(col, row), (col + 1, row), (col, row + 1), (col + 1, row + 1)];
                let corners = corners.map(|(c, r)| self.corner(camera, c, r, map.altitude.at(c, r)));
                for [a, b, c] in [[0, 1, 2], [3, 2, 1]] {
                    self.triangle([corners[a], corners[b], corners[c]], map.score.at(col, row));
                }
            }
        }
    }

    /// Position of a pixel's point on the grid, in cells with centres at whole numbers, and its altitude.
    fn corner(&self, camera: &AffineCamera, col: usize, row: usize, z: f32) -> [f32; 3] {
        let [x, y] = camera.place_at(Pixel::new(col as f64, row as f64), f64::from(z));
        let east = (x + self.origin[0] - self.grid.west) / self.grid.cell - 0.5;
        let south = (self.grid.north - y - self.origin[1]) / self.grid.cell - 0.5;
        [east as f32, south as f32, z]
    }

    fn triangle(&mut self, p: [[f32; 3]; 3], score: f32) {
        let [a, b, c] = p;
        let climb = a[2].max(b[2]).max(c[2]) - a[2].min(b[2]).min(c[2]);
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        // NaN altitudes make NaN areas.
        if area.is_nan() || area == 0.0 || climb > self.step_m {
            return;
        }
        let cells = |axis: usize, n: usize| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            low.ceil().max(0.0) as usize..(high.floor() + 1.0).clamp(0.0, n as f32) as usize
        };
        let cols = cells(0, self.grid.width);
        for row in cells(1, self.grid.height) {
            for col in cols.clone() {
                let (x, y) = (col as f32, row as f32);
                let edge = |p: [f32; 3], q: [f32; 3]| (q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1]);
                let weights = [edge(b, c), edge(c, a), edge(a, b)].map(|e| e / area);
                if weights.iter().any(|w| *w < -1e-4) {
                    continue;
                }
                let z = weights[0] * a[2] + weights[1] * b[2] + weights[2] * c[2];
                let i = row * self.grid.width + col;
                if self.altitude.data[i].is_nan() || self.altitude.data[i] < z {
                    (self.altitude.data[i], self.score.data[i]) = (z, score);
                }
            }
        }
    }
}

/// Closes gaps of few cells between cells of one surface, no further apart than `most_m`: the mean of both sides and
/// their scores.
fn close_gaps(altitude: &mut Grid2, score: &mut Grid2, most_m: f32) {
    let (known, scores) = (altitude.clone(), score.clone());
    let width = known.width;
    let rows = altitude.data.par_chunks_mut(width).zip(score.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(row, (altitude, score))| {
        for (col, (z, s)) in altitude.iter_mut().zip(score).enumerate().filter(|(_, (z, _))| z.is_nan()) {
            let nearest = |c: i64, r: i64| {
                let cells = (1..=GAP).map(|k| (col as i64 + c * k, row as i64 + r * k));
                let mut values = cells.map(|(c, r)| (known.get(c, r), scores.get(c, r)));
                values.find(|(z, _)| !z.is_nan())
            };
            let across = DIRECTIONS[..4].iter().filter_map(|(c, r)| nearest(*c, *r).zip(nearest(-c, -r)));
            let flattest = across.min_by(|(a, b), (c, d)| (a.0 - b.0).abs().total_cmp(&(c.0 - d.0).abs()));
            if let Some((a, b)) = flattest.filter(|(a, b)| (a.0 - b.0).abs() <= most_m) {
                (*z, *s) = (0.5 * (a.0 + b.0), 0.5 * (a.1 + b.1));
            }
        }
    });
}

/// Fills what no two views agree on, where two views have it in their images; the score there is 0.
fn fill(sweep: &PlaneSweep, altitude: &mut Grid2, score: &mut Grid2) {
    let known = altitude.clone();
    let reach = (FILL_M / sweep.grid.cell) as i64;
    let filled = |col: usize, row: usize| {
        let along = |(c, r): &(i64, i64)| {
            let mut values = (1..=reach).map(|k| known.get(col as i64 + c * k, row as i64 + r * k));
            values.find(|z| !z.is_nan())
        };
        let mut found: Vec<f32> = DIRECTIONS.iter().filter_map(along).collect();
        found.sort_unstable_by(f32::total_cmp);
        if found.len() < FILL_DIRECTIONS { None } else { found.get(FILL_RANK).copied() }
    };
    let width = known.width;
    let rows = altitude.data.par_chunks_mut(width).zip(score.data.par_chunks_mut(width));
    rows.enumerate().for_each(|(row, (altitude, score))| {
        for (col, (z, s)) in altitude.iter_mut().zip(score).enumerate().filter(|(_, (z, _))| z.is_nan()) {
            *s = 0.0;
            let Some(from_around) = filled(col, row) else { continue };
            let p = sweep.site.site_from_utm(sweep.grid.cell_center(col, row));
            let place: Point<_> = p.at_height(f64::from(from_around));
            if sweep.images.iter().filter(|i| i.has(place)).count() >= 2 {
                *z = from_around;
            }
        }
    });
}
