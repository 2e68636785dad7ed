//! The start: a splat at and around every sparse point, and a carpet for shadows to fall on (BAEOGS §3.1).

use super::gaussians::Gaussians;
use super::random::Draw;
use super::recipe::Carpet;
use crate::frame::{Point, Site};
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// Copies of each sparse point, and their distance from it in metres.
const COPIES: usize = 4;
const COPY_DISTANCE_M: f64 = 0.02;
/// Opacity at the start; the paper's 1.0 has no logit.
const OPACITY: f64 = 0.99;
/// Bounds of a splat's scale at the start, metres.
const SCALE_M: (f64, f64) = (0.05, 2.0);
/// Share of the sparse points below the carpet's plane.
const PLANE_SHARE: f64 = 0.02;
/// Side of the cells in which the ground is looked for, metres, and the share of a cell's points below it.
const GROUND_CELL_M: f64 = 30.0;
const GROUND_SHARE: f64 = 0.1;
/// Purposes of random draws.
const DRAW_COPY: u64 = 1;
const DRAW_CARPET: u64 = 2;

/// A box on the map grid, site metres: west, south, east, north.
pub type SiteBox = (f64, f64, f64, f64);

/// The splats that training starts from.
#[must_use]
pub fn start(sparse: &[Point<Site>], area: SiteBox, carpet: Carpet, seed: u64) -> Gaussians {
    let mut points = Vec::with_capacity(sparse.len() * (COPIES + 1));
    for (i, p) in sparse.iter().enumerate() {
        points.push(p.xyz());
        for k in 0..COPIES {
            let d = Draw::new(seed, DRAW_COPY, k as u64, i as u64).direction();
            let p = p.xyz();
            points.push(std::array::from_fn(|a| p[a] + COPY_DISTANCE_M * d[a]));
        }
    }
    let ground = Ground::new(sparse, area, carpet);
    let (west, south, east, north) = area;
    let count = ((east - west) * (north - south)).max(0.0) as usize;
    let carpet: Vec<[f64; 3]> = (0..count)
        .map(|i| {
            let mut draw = Draw::new(seed, DRAW_CARPET, 0, i as u64);
            let x = west + (east - west) * draw.uniform();
            let y = south + (north - south) * draw.uniform();
            [x, y, ground.altitude(x, y)]
        })
        .collect();
    let mut out = Gaussians::default();
    // Sparse points and carpet find their neighbours each among themselves.
    for (points, gray) in [(points, 1.0), (carpet, 0.0)] {
        for (p, scale) in points.iter().zip(neighbour_scales(&points)) {
            out.push(p.map(|v| v as f32), scale as f32, OPACITY as f32, [gray; 3]);
        }
    }
    out
}

/// Root mean square distance to the three nearest others, clamped (3DGS).
fn neighbour_scales(points: &[[f64; 3]]) -> Vec<f64> {
    const NEIGHBOURS: NonZero<usize> = NonZero::new(4).unwrap();
    let tree = ImmutableKdTree::<f64, 3>::new_from_slice(points);
    let Ok(tree) = tree else { return vec![SCALE_M.1; points.len()] };
    points
        .iter()
        .map(|p| {
            // The nearest is the point itself.
            let near = tree.query(p).nearest_n::<SquaredEuclidean<f64>>(NEIGHBOURS).execute();
            let squares: Vec<f64> = near.iter().skip(1).map(|n| n.distance).collect();
            let mean = squares.iter().sum::<f64>() / squares.len().max(1) as f64;
            mean.sqrt().clamp(SCALE_M.0, SCALE_M.1)
        })
        .collect()
}

/// The altitude of the ground, from sparse points.
struct Ground {
    west: f64,
    south: f64,
    columns: usize,
    rows: usize,
    /// Altitudes at cell centres, row by row from the south.
    altitudes: Vec<f64>,
}

impl Ground {
    fn new(sparse: &[Point<Site>], (west, south, east, north): SiteBox, carpet: Carpet) -> Self {
        let all: Vec<f64> = sparse.iter().map(|p| p.z()).collect();
        let plane = quantile(all, PLANE_SHARE).unwrap_or(0.0);
        if carpet == Carpet::Plane {
            return Self { west, south, columns: 1, rows: 1, altitudes: vec![plane] };
        }
        let columns = (((east - west) / GROUND_CELL_M).ceil() as usize).max(1);
        let rows = (((north - south) / GROUND_CELL_M).ceil() as usize).max(1);
        let mut cells = vec![Vec::new(); columns * rows];
        for p in sparse {
            let c = ((p.x() - west) / GROUND_CELL_M).floor();
            let r = ((p.y() - south) / GROUND_CELL_M).floor();
            if c >= 0.0 && r >= 0.0 && c < columns as f64 && r < rows as f64 {
                cells[r as usize * columns + c as usize].push(p.z());
            }
        }
        let low: Vec<Option<f64>> = cells.into_iter().map(|z| quantile(z, GROUND_SHARE)).collect();
        // A cell without ground (a roof fills it, or no point fell there) asks a wider and wider neighbourhood;
        // one pass of smoothing follows.
        let filled: Vec<f64> = (0..columns * rows)
            .map(|i| nearest_mean(&low, columns, rows, i % columns, i / columns).unwrap_or(plane))
            .collect();
        let altitudes =
            (0..columns * rows).map(|i| smoothed(&filled, columns, rows, i % columns, i / columns));
        Self { west, south, columns, rows, altitudes: altitudes.collect() }
    }

    /// Bilinear between cell centres, constant beyond them.
    fn altitude(&self, x: f64, y: f64) -> f64 {
        let axis = |v: f64, start: f64, n: usize| {
            let t = ((v - start) / GROUND_CELL_M - 0.5).clamp(0.0, n as f64 - 1.0);
            let i = (t.floor() as usize).min(n.saturating_sub(2));
            (i, (i + 1).min(n - 1), t - i as f64)
        };
        let (c0, c1, fx) = axis(x, self.west, self.columns);
        let (r0, r1, fy) = axis(y, self.south, self.rows);
        let at = |c: usize, r: usize| self.altitudes[r * self.columns + c];
        let line = |r: usize| at(c0, r) + (at(c1, r) - at(c0, r)) * fx;
        line(r0) + (line(r1) - line(r0)) * fy
    }
}

/// Mean of the cells with a value in the smallest square around a cell that has any.
fn nearest_mean(cells: &[Option<f64>], columns: usize, rows: usize, col: usize, row: usize) -> Option<f64> {
    (0..columns.max(rows)).find_map(|reach| {
        let square = window(cells, columns, rows, col, row, reach);
        let known: Vec<f64> = square.flatten().collect();
        (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
    })
}

fn smoothed(cells: &[f64], columns: usize, rows: usize, col: usize, row: usize) -> f64 {
    let values: Vec<f64> = window(cells, columns, rows, col, row, 1).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

fn window<V: Copy>(
    cells: &[V],
    columns: usize,
    rows: usize,
    col: usize,
    row: usize,
    reach: usize,
) -> impl Iterator<Item = V> + '_ {
    let (r0, r1) = (row.saturating_sub(reach), (row + reach).min(rows - 1));
    let (c0, c1) = (col.saturating_sub(reach), (col + reach).min(columns - 1));
    (r0..=r1).flat_map(move |r| (c0..=c1).map(move |c| cells[r * columns + c]))
}

/// The value below which a share of the values lies.
#[must_use]
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let rank = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(rank.min(last), f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slope() -> Vec<Point<Site>> {
        (0..4000)
            .map(|i| {
                let mut d = Draw::new(5, 0, 0, i);
                let (x, y) = (200.0 * d.uniform() - 100.0, 160.0 * d.uniform() - 80.0);
                Point::new(x, y, 0.3 * x)
            })
            .collect()
    }

    #[test]
    fn the_carpet_has_one_splat_a_square_metre_and_follows_a_slope() {
        let sparse = slope();
        let g = start(&sparse, (-100.0, -80.0, 100.0, 80.0), Carpet::Ground, 0);
        assert_eq!(g.len(), 5 * sparse.len() + 200 * 160);
        let carpet = &g.position[5 * sparse.len()..];
        let off = carpet.iter().filter(|p| p[0].abs() < 70.0).map(|p| (p[2] - 0.3 * p[0]).abs());
        assert!(off.fold(0.0, f32::max) < 5.0);
    }

    #[test]
    fn the_plane_lies_below_all_but_two_percent() {
        let sparse = slope();
        let g = start(&sparse, (-10.0, -10.0, 10.0, 10.0), Carpet::Plane, 0);
        let z = f64::from(g.position[5 * sparse.len()][2]);
        let below = sparse.iter().filter(|p| p.z() < z - 1e-3).count();
        assert!((60..=90).contains(&below), "{below}");
    }

    #[test]
    fn scales_stay_within_their_bounds() {
        let g = start(&slope(), (-100.0, -80.0, 100.0, 80.0), Carpet::Ground, 0);
        let (lo, hi) = ((SCALE_M.0 * 0.999) as f32, (SCALE_M.1 * 1.001) as f32);
        assert!(g.log_scale.iter().all(|s| (lo..=hi).contains(&s[0].exp())));
    }
}
