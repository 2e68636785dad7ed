//! Clouds as stereo matching would give them, drawn from an exact surface.

use super::surface::ExactSurface;
use crate::random::CounterRng;
use crate::stats::quantile;

/// Purposes of the random numbers.
const DRAW_KIND: u64 = 50;
const DRAW_POINT: u64 = 51;
const DRAW_NODE: u64 = 52;
/// Vertical errors: range of the standard deviation in metres, and distance over which errors are alike.
const ERROR_M: (f64, f64) = (0.05, 0.4);
const CORRELATION_M: f64 = 2.0;
/// Horizontal errors, metres.
const SHIFT_M: f64 = 0.15;
/// Share of points that are wrong, by at most so many metres.
const OUTLIERS: f64 = 0.03;
const OUTLIER_M: f64 = 10.0;
/// Largest number and radius of holes, metres.
const HOLES: usize = 6;
const HOLE_M: (f64, f64) = (1.0, 5.0);
/// Share of clouds whose heights are smoothed as by a matching window.
const SMOOTHED: f64 = 0.7;
/// Part of the points that thinned clouds have at least.
const THINNEST: f64 = 0.01;

/// Part of the points that a cloud has: all for every second one, else fewer, all orders of magnitude alike.
pub fn draw_share(seed: u64, cloud: u64) -> f64 {
    let mut draw = CounterRng::new(seed, DRAW_KIND, cloud, 1);
    let exponent = draw.uniform();
    if draw.uniform() < 0.5 { 1.0 } else { THINNEST.powf(exponent) }
}

/// The points that matching could give of a surface: with errors, outliers and holes. `share` of its cells have one; `cloud` is
/// the number of the cloud.
pub fn draw(surface: &ExactSurface, seed: u64, cloud: u64, share: f64) -> Vec<[f64; 3]> {
    let mut kind = CounterRng::new(seed, DRAW_KIND, cloud, 0);
    let error_m = ERROR_M.0 * (ERROR_M.1 / ERROR_M.0).powf(kind.uniform());
    let is_smoothed = kind.uniform() < SMOOTHED;
    let (width, height) = (surface.altitude.width, surface.altitude.height);
    let cell = surface.cell_m();
    let holes: Vec<[f64; 3]> = (0..kind.below(HOLES + 1))
        .map(|_| {
            let [x, y] = surface.center(kind.below(width), kind.below(height));
            [x, y, HOLE_M.0 + (HOLE_M.1 - HOLE_M.0) * kind.uniform()]
        })
        .collect();
    let mut points = Vec::new();
    for i in 0..width * height {
        let mut draw = CounterRng::new(seed, DRAW_POINT, cloud, i as u64);
        if draw.uniform() >= share {
            continue;
        }
        let (col, row) = (i % width, i / width);
        let [x, y] = surface.center(col, row);
        if holes.iter().any(|[hx, hy, radius]| (x - hx).hypot(y - hy) < *radius) {
            continue;
        }
        let z =
            if is_smoothed { median(surface, col, row) } else { f64::from(surface.altitude.at(col, row)) };
        let place = [x, y].map(|v| v + cell * (draw.uniform() - 0.5) + SHIFT_M * draw.normal());
        let error = error_m * correlated_normal(seed, cloud, place);
        let is_outlier = draw.uniform() < OUTLIERS;
        let wrong = if is_outlier { OUTLIER_M * (2.0 * draw.uniform() - 1.0) } else { 0.0 };
        points.push([place[0], place[1], z + error + wrong]);
    }
    points
}

/// The median altitude of a cell and those around it.
fn median(surface: &ExactSurface, col: usize, row: usize) -> f64 {
    let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (col as i64 + dx, row as i64 + dy)));
    let heights = around.map(|(c, r)| f64::from(surface.altitude.get(c, r))).filter(|z| z.is_finite());
    quantile(heights.collect(), 0.5).unwrap_or_else(|| f64::from(surface.altitude.at(col, row)))
}

/// A normal random number that is nearly the same for positions close to each other.
fn correlated_normal(seed: u64, cloud: u64, [x, y]: [f64; 2]) -> f64 {
    let (x, y) = (x / CORRELATION_M, y / CORRELATION_M);
    let (u, v) = (x - x.floor(), y - y.floor());
    let node = |dx: i64, dy: i64| {
        // Positions are within some kilometres of the origin.
        let [i, j] =
            [(x.floor() as i64, dx), (y.floor() as i64, dy)].map(|(v, d)| (v + d + (1 << 20)) as u64);
        CounterRng::new(seed, DRAW_NODE, cloud, (i << 32) | j).normal()
    };
    let near = (1.0 - v) * ((1.0 - u) * node(0, 0) + u * node(1, 0));
    near + v * ((1.0 - u) * node(0, 1) + u * node(1, 1))
}
