//! Depths for holes, from the farther side of what is around.
//!
//! A hole that opens when a scene is seen from elsewhere shows what something nearer had hidden. Of the known pixels beside a hole,
//! those whose inverse depth is above the middle of the range are left out if that range is wide. Inverse depths of a plane are
//! linear in the image: where one plane fits the rest, it fills the hole, else the solution of Laplace's equation with the values
//! at the rest, and no flux through all other borders.

use crate::io::Grid2;
use crate::prior::conjugate_gradients::{Limits, solve};
use nalgebra::{Matrix3, Vector3};

/// Range of the inverse depths around a hole, as a share of the greatest, beyond which the nearer half is left out.
const WIDE: f64 = 0.02;
/// A plane fits if its residuals have a root mean square below this share of the mean inverse depth.
const PLANE: f64 = 0.01;
/// A plane needs values that are not nearly in a line: the ratio of the standard deviations across and along.
const LEAST_RATIO: f64 = 0.2;
/// When conjugate gradients end.
const LIMITS: Limits = Limits { steps: 2000, residual: 1e-5 };
/// What fills a hole is at most this many times as far, and as near, as what is around.
const BEYOND: f64 = 1.5;

/// Fills the pixels of holes with depths; holes without known pixels beside them stay as they are.
pub(super) fn fill_holes(depth: &mut Grid2, hole: &[bool]) {
    let (width, height) = (depth.width, depth.height);
    let mut seen = vec![false; hole.len()];
    for start in 0..hole.len() {
        if !hole[start] || seen[start] {
            continue;
        }
        let pixels = connected(start, hole, &mut seen, (width, height));
        let Some(values) = filled(&pixels, depth, hole) else { continue };
        for (i, value) in pixels.into_iter().zip(values) {
            depth.data[i] = value as f32;
        }
    }
}

/// The pixels of a hole.
fn connected(start: usize, hole: &[bool], seen: &mut [bool], size: (usize, usize)) -> Vec<usize> {
    let (mut pixels, mut next) = (vec![start], 0);
    seen[start] = true;
    while next < pixels.len() {
        for i in beside(pixels[next], size) {
            if hole[i] && !seen[i] {
                seen[i] = true;
                pixels.push(i);
            }
        }
        next += 1;
    }
    pixels
}

/// The pixels left, right, above and below.
fn beside(i: usize, (width, height): (usize, usize)) -> impl Iterator<Item = usize> {
    let (col, row) = (i % width, i / width);
    [
        (col > 0).then(|| i - 1),
        (col + 1 < width).then_some(i + 1),
        (row > 0).then(|| i - width),
        (row + 1 < height).then_some(i + width),
    ]
    .into_iter()
    .flatten()
}

/// Depths for the pixels of a hole.
fn filled(pixels: &[usize], depth: &Grid2, hole: &[bool]) -> Option<Vec<f64>> {
    let size = (depth.width, depth.height);
    let mut rim: Vec<usize> = pixels.iter().flat_map(|i| beside(*i, size)).filter(|i| !hole[*i]).collect();
    rim.retain(|i| depth.data[*i].is_finite());
    rim.sort_unstable();
    rim.dedup();
    let inverse = |i: usize| 1.0 / f64::from(depth.data[i]);
    let range = |rim: &[usize]| {
        rim.iter().map(|i| inverse(*i)).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)))
    };
    let (low, high) = range(&rim);
    if high - low > WIDE * high {
        rim.retain(|i| inverse(*i) <= 0.5 * (low + high));
    }
    let known: Vec<(usize, f64)> = rim.iter().map(|i| (*i, inverse(*i))).collect();
    if known.is_empty() {
        return None;
    }
    let values = on_plane(pixels, &known, depth.width).unwrap_or_else(|| harmonic(pixels, &known, size));
    let (low, high) = range(&rim);
    Some(values.into_iter().map(|v| 1.0 / v.clamp(low / BEYOND, high * BEYOND)).collect())
}

/// Values of the plane through known ones; none if no plane fits them or they are nearly in a line.
fn on_plane(pixels: &[usize], known: &[(usize, f64)], width: usize) -> Option<Vec<f64>> {
    let count = known.len() as f64;
    let at = |i: usize| ((i % width) as f64, (i / width) as f64);
    let mean = known.iter().fold((0.0, 0.0, 0.0), |sum, (i, v)| {
        let (col, row) = at(*i);
        (sum.0 + col / count, sum.1 + row / count, sum.2 + v / count)
    });
    let row_of = |i: usize| Vector3::new(at(i).0 - mean.0, at(i).1 - mean.1, 1.0);
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (i, value) in known {
        let row = row_of(*i);
        normal += row * row.transpose();
        right += row * *value;
    }
    let (a, b, c) = (normal[(0, 0)], normal[(0, 1)], normal[(1, 1)]);
    let root = (0.25 * (a - c).powi(2) + b * b).sqrt();
    let (along, across) = (0.5 * (a + c) + root, 0.5 * (a + c) - root);
    if across <= LEAST_RATIO * LEAST_RATIO * along {
        return None;
    }
    let plane = normal.cholesky()?.solve(&right);
    let square = known.iter().map(|(i, v)| (row_of(*i).dot(&plane) - v).powi(2)).sum::<f64>() / count;
    (square.sqrt() < PLANE * mean.2).then(|| pixels.iter().map(|i| row_of(*i).dot(&plane)).collect())
}

/// The solution of Laplace's equation with these values beside the pixels, by conjugate gradients.
fn harmonic(pixels: &[usize], known: &[(usize, f64)], size: (usize, usize)) -> Vec<f64> {
    const OUTSIDE: u32 = u32::MAX;
    let count = size.0 * size.1;
    let (mut place, mut value) = (vec![OUTSIDE; count], vec![f64::NAN; count]);
    pixels.iter().enumerate().for_each(|(k, i)| place[*i] = k as u32);
    known.iter().for_each(|(i, v)| value[*i] = *v);
    let mean = known.iter().map(|k| k.1).sum::<f64>() / known.len() as f64;
    // For each pixel: its neighbours among the pixels, the number of terms, and the sum of known values less the mean.
    let row = |i: &usize| {
        let (mut near, mut terms, mut sum) = ([OUTSIDE; 4], 0.0, 0.0);
        for (slot, k) in near.iter_mut().zip(beside(*i, size)) {
            if place[k] != OUTSIDE {
                (*slot, terms) = (place[k], terms + 1.0);
            } else if value[k].is_finite() {
                (sum, terms) = (sum + value[k] - mean, terms + 1.0);
            }
        }
        (near, terms, sum)
    };
    let rows: Vec<([u32; 4], f64, f64)> = pixels.iter().map(row).collect();
    let apply = |x: &[f64], out: &mut Vec<f64>| {
        out.clear();
        out.extend(rows.iter().enumerate().map(|(k, (near, terms, _))| {
            let sum: f64 = near.iter().filter(|n| **n != OUTSIDE).map(|n| x[*n as usize]).sum();
            terms * x[k] - sum
        }));
    };
    let right: Vec<f64> = rows.iter().map(|r| r.2).collect();
    let mut x = vec![0.0; pixels.len()];
    solve(apply, &vec![1.0; pixels.len()], &right, &mut x, &LIMITS);
    x.into_iter().map(|x| x + mean).collect()
}
