//! Points drawn as squares, the nearest in front.

use super::super::hdd::cloud::SurfacePoint;
use crate::io::Grid2;
use crate::perspective::PinholeCamera;
use crate::stats::quantile;

/// Side of a square in spacings of points, and least side, pixels.
const SIDE: f64 = 1.2;
const LEAST_PX: f64 = 2.0;
/// A pixel without a point gets the median depth of the eight around it if at least so many have one.
const CLOSES: usize = 5;
/// Holes lose what is narrower than this many pixels to each side, and then grow by so many, because their rims mix near and far.
const OPENED_PX: usize = 1;
const GROWN_PX: usize = 2;

/// A picture of points.
pub(super) struct Drawn {
    /// Depth of each pixel along the optical axis; NaN in holes.
    pub depth: Grid2,
    /// Colours, row by row, black in holes.
    pub colors: Vec<[u8; 3]>,
    /// Whether a pixel is in a hole.
    pub hole: Vec<bool>,
}

/// Draws points as a camera sees them.
pub(super) fn draw(points: &[SurfacePoint], camera: &PinholeCamera) -> Drawn {
    let (width, height) = camera.size;
    let mut depth = Grid2::filled(width, height, f32::INFINITY);
    let mut colors = vec![[0; 3]; width * height];
    for p in points {
        let z = (camera.cam_from_site * (p.position - camera.center)).z;
        let Some(px) = camera.project(p.point()) else { continue };
        let half = 0.5 * (SIDE * p.spacing * camera.focal.max_element() / z).max(LEAST_PX);
        let range = |at: f64, size: usize| {
            let first = (at - half).ceil().clamp(0.0, size as f64) as usize;
            first..((at + half).ceil().clamp(0.0, size as f64) as usize)
        };
        for row in range(px.row, height) {
            for col in range(px.col, width) {
                let i = row * width + col;
                if (z as f32) < depth.data[i] {
                    (depth.data[i], colors[i]) = (z as f32, p.rgb);
                }
            }
        }
    }
    depth.data.iter_mut().filter(|d| d.is_infinite()).for_each(|d| *d = f32::NAN);
    close(&mut depth, &mut colors);
    let empty: Vec<bool> = depth.data.iter().map(|d| d.is_nan()).collect();
    let known: Vec<bool> = empty.iter().map(|e| !e).collect();
    let inner: Vec<bool> =
        grown(&known, width, OPENED_PX).into_iter().map(|near_known| !near_known).collect();
    let hole = grown(&inner, width, OPENED_PX + GROWN_PX);
    for ((depth, color), is_hole) in depth.data.iter_mut().zip(&mut colors).zip(&hole) {
        if *is_hole {
            (*depth, *color) = (f32::NAN, [0; 3]);
        }
    }
    Drawn { depth, colors, hole }
}

/// Fills single pixels between others.
fn close(depth: &mut Grid2, colors: &mut [[u8; 3]]) {
    let (width, height) = (depth.width, depth.height);
    let mut closed = Vec::new();
    for i in (0..width * height).filter(|i| depth.data[*i].is_nan()) {
        let (col, row) = ((i % width) as i64, (i / width) as i64);
        let around = (-1..=1).flat_map(|dr| (-1..=1).map(move |dc| (col + dc, row + dr)));
        let known: Vec<(f64, usize)> = around
            .filter(|(c, r)| depth.get(*c, *r).is_finite())
            .map(|(c, r)| (f64::from(depth.get(c, r)), r as usize * width + c as usize))
            .collect();
        if known.len() < CLOSES {
            continue;
        }
        let median = quantile(known.iter().map(|k| k.0).collect(), 0.5).unwrap_or_default();
        let nearest = known.iter().min_by(|a, b| (a.0 - median).abs().total_cmp(&(b.0 - median).abs()));
        closed.extend(nearest.map(|(_, from)| (i, median as f32, colors[*from])));
    }
    for (i, value, color) in closed {
        (depth.data[i], colors[i]) = (value, color);
    }
}

/// A mask that is true within `by` pixels of where it was, along rows and columns.
fn grown(mask: &[bool], width: usize, by: usize) -> Vec<bool> {
    let height = mask.len() / width.max(1);
    let any = |mask: &[bool], at: &dyn Fn(usize) -> usize, i: usize, size: usize| {
        (i.saturating_sub(by)..(i + by + 1).min(size)).any(|k| mask[at(k)])
    };
    let across: Vec<bool> =
        (0..mask.len()).map(|i| any(mask, &|k| i / width * width + k, i % width, width)).collect();
    (0..mask.len()).map(|i| any(&across, &|k| k * width + i % width, i / width, height)).collect()
}
