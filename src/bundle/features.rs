//! Keypoints: where they are, how large, which way they point, and what they look like (Lowe 2004, §§5 and 6).
//!
//! Descriptors are RootSIFT (Arandjelović & Zisserman 2012): their scalar product is the similarity.

use super::scale_space::{Octave, SCALES, SIGMA, extrema, octaves};
use crate::frame::{CenterPx, Pixel};
use crate::raster::Plane;
use rayon::prelude::*;
use std::f32::consts::{PI, TAU};

/// Values of a descriptor: 4 x 4 cells of 8 directions.
pub const VALUES: usize = 128;
/// Side of the cells in which keypoints compete, pixels, and how many each keeps: 8,500 per megapixel.
const CELL_PX: usize = 64;
const PER_CELL: usize = 35;
/// Distance to missing pixels within which there are no keypoints.
const MASK_REACH_PX: i64 = 10;
const DIRECTIONS: usize = 36;
/// Peaks of the direction histogram this near to the highest are keypoints of their own.
const SECOND_PEAK: f32 = 0.8;

/// A keypoint.
#[derive(Clone, Debug)]
pub struct Keypoint {
    /// Where.
    pub px: Pixel<CenterPx>,
    /// Blur at which it was found, pixels.
    pub scale: f32,
    /// What it looks like: non-negative, of length one.
    pub descriptor: [f32; VALUES],
}

/// Finds the keypoints of a grey image in [0, 1]; NaN pixels are missing.
#[must_use]
pub fn detect(image: &Plane) -> Vec<Keypoint> {
    let known: Vec<f32> = image.valid().collect();
    if known.is_empty() {
        return Vec::new();
    }
    let mean = known.iter().sum::<f32>() / known.len() as f32;
    let masked = known.len() < image.data.len();
    let filled = Plane {
        data: image.data.iter().map(|v| if v.is_nan() { mean } else { *v }).collect(),
        ..image.clone()
    };
    let octaves = octaves(&filled);
    let mut found = extrema(&octaves);
    if masked {
        found.retain(|e| !near_missing(image, e.position, octaves[e.octave].step));
    }
    let strongest = spread(found, &octaves, image);
    let described: Vec<Vec<Keypoint>> = strongest
        .par_iter()
        .map(|e| {
            let octave = &octaves[e.octave];
            let level = (e.position[2].round() as usize).clamp(0, SCALES + 2);
            let scale = SIGMA as f32 * 2f32.powf(e.position[2] / SCALES as f32);
            let plane = &octave.levels[level];
            directions(plane, e.position, scale)
                .into_iter()
                .filter_map(|direction| {
                    Some(Keypoint {
                        px: Pixel::new(
                            f64::from(e.position[0]) * octave.step,
                            f64::from(e.position[1]) * octave.step,
                        ),
                        scale: scale * octave.step as f32,
                        descriptor: describe(plane, e.position, scale, direction)?,
                    })
                })
                .collect()
        })
        .collect();
    described.into_iter().flatten().collect()
}

fn near_missing(image: &Plane, position: [f32; 3], step: f64) -> bool {
    let at = |p: f32| (f64::from(p) * step).round() as i64;
    let (col, row) = (at(position[0]), at(position[1]));
    let reach = [-MASK_REACH_PX, 0, MASK_REACH_PX];
    reach.iter().any(|dr| reach.iter().any(|dc| image.get(col + dc, row + dr).is_nan()))
}

/// The strongest extrema of each cell, so that keypoints cover the image.
fn spread(
    mut found: Vec<super::scale_space::Extremum>,
    octaves: &[Octave],
    image: &Plane,
) -> Vec<super::scale_space::Extremum> {
    let columns = image.width.div_ceil(CELL_PX);
    let mut room = vec![PER_CELL; columns * image.height.div_ceil(CELL_PX)];
    // A stable sort: equal responses keep the order in which they were found.
    found.sort_by(|a, b| b.response.abs().total_cmp(&a.response.abs()));
    found.retain(|e| {
        let step = octaves[e.octave].step as f32;
        let cell = |p: f32| ((p * step) as usize) / CELL_PX;
        let room = &mut room[cell(e.position[1]) * columns + cell(e.position[0])];
        let keep = *room > 0;
        *room = room.saturating_sub(1);
        keep
    });
    found
}

/// Gradient of a blurred image: (magnitude, direction); none at the border.
#[inline(always)]
fn gradient(plane: &Plane, col: i64, row: i64) -> Option<(f32, f32)> {
    let inside = col > 0 && row > 0 && col + 1 < plane.width as i64 && row + 1 < plane.height as i64;
    if !inside {
        return None;
    }
    let (c, r) = (col as usize, row as usize);
    let dx = plane.at(c + 1, r) - plane.at(c - 1, r);
    let dy = plane.at(c, r + 1) - plane.at(c, r - 1);
    Some((dx.hypot(dy), dy.atan2(dx)))
}

/// The dominant gradient directions around a point.
fn directions(plane: &Plane, at: [f32; 3], scale: f32) -> Vec<f32> {
    let sigma = 1.5 * scale;
    let reach = (3.0 * sigma).round() as i64;
    let (c0, r0) = (at[0].round() as i64, at[1].round() as i64);
    let mut histogram = [0.0f32; DIRECTIONS];
    for row in r0 - reach..=r0 + reach {
        for col in c0 - reach..=c0 + reach {
            let Some((magnitude, direction)) = gradient(plane, col, row) else { continue };
            let (dx, dy) = (col as f32 - at[0], row as f32 - at[1]);
            let weight = (-(dx * dx + dy * dy) / (2.0 * sigma * sigma)).exp();
            let bin = (direction / TAU * DIRECTIONS as f32).rem_euclid(DIRECTIONS as f32);
            let low = bin.floor();
            let part = bin - low;
            let low = low as usize % DIRECTIONS;
            histogram[low] += (1.0 - part) * weight * magnitude;
            histogram[(low + 1) % DIRECTIONS] += part * weight * magnitude;
        }
    }
    for _ in 0..3 {
        let h = histogram;
        for i in 0..DIRECTIONS {
            let (before, after) = (h[(i + DIRECTIONS - 1) % DIRECTIONS], h[(i + 1) % DIRECTIONS]);
            histogram[i] = 0.25 * before + 0.5 * h[i] + 0.25 * after;
        }
    }
    let highest = histogram.iter().fold(0.0f32, |m, v| m.max(*v));
    let mut out = Vec::new();
    for i in 0..DIRECTIONS {
        let (before, here, after) =
            (histogram[(i + DIRECTIONS - 1) % DIRECTIONS], histogram[i], histogram[(i + 1) % DIRECTIONS]);
        if here > before && here >= after && here >= SECOND_PEAK * highest {
            let offset = 0.5 * (before - after) / (before - 2.0 * here + after);
            out.push((i as f32 + offset) / DIRECTIONS as f32 * TAU);
        }
    }
    out
}

/// The RootSIFT descriptor; none if nothing is there to describe.
fn describe(plane: &Plane, at: [f32; 3], scale: f32, direction: f32) -> Option<[f32; VALUES]> {
    let cell = 3.0 * scale;
    let reach = (cell * 2.5 * std::f32::consts::SQRT_2).round() as i64;
    let (sin, cos) = direction.sin_cos();
    let (c0, r0) = (at[0].round() as i64, at[1].round() as i64);
    let mut histogram = [0.0f32; VALUES];
    for row in r0 - reach..=r0 + reach {
        for col in c0 - reach..=c0 + reach {
            let (dx, dy) = (col as f32 - at[0], row as f32 - at[1]);
            let (x, y) = ((cos * dx + sin * dy) / cell, (cos * dy - sin * dx) / cell);
            let (bx, by) = (x + 1.5, y + 1.5);
            if bx <= -1.0 || by <= -1.0 || bx >= 4.0 || by >= 4.0 {
                continue;
            }
            let Some((magnitude, angle)) = gradient(plane, col, row) else { continue };
            // Lowe's window: half the descriptor's width.
            let weight = magnitude * (-(x * x + y * y) / 8.0).exp();
            let mut turned = angle - direction;
            if turned < -PI {
                turned += TAU;
            }
            let bo = (turned / TAU * 8.0).rem_euclid(8.0);
            add_trilinear(&mut histogram, bx, by, bo, weight);
        }
    }
    let norm = histogram.iter().map(|v| v * v).sum::<f32>().sqrt();
    if norm <= f32::MIN_POSITIVE {
        return None;
    }
    for v in &mut histogram {
        *v = (*v / norm).min(0.2);
    }
    let sum: f32 = histogram.iter().sum();
    Some(histogram.map(|v| (v / sum).sqrt()))
}

#[inline(always)]
fn add_trilinear(histogram: &mut [f32; VALUES], bx: f32, by: f32, bo: f32, weight: f32) {
    let (x0, y0, o0) = (bx.floor(), by.floor(), bo.floor());
    let (fx, fy, fo) = (bx - x0, by - y0, bo - o0);
    for (dy, wy) in [(0, 1.0 - fy), (1, fy)] {
        let y = y0 as i64 + dy;
        if !(0..4).contains(&y) {
            continue;
        }
        for (dx, wx) in [(0, 1.0 - fx), (1, fx)] {
            let x = x0 as i64 + dx;
            if !(0..4).contains(&x) {
                continue;
            }
            let base = ((y * 4 + x) * 8) as usize;
            let o = o0 as usize;
            histogram[base + o % 8] += weight * wy * wx * (1.0 - fo);
            histogram[base + (o + 1) % 8] += weight * wy * wx * fo;
        }
    }
}

/// Scalar product of two descriptors: 1 for equal ones.
#[inline(always)]
#[must_use]
pub fn similarity(a: &[f32; VALUES], b: &[f32; VALUES]) -> f32 {
    let mut sum = [0.0f32; 16];
    for (a, b) in a.chunks_exact(16).zip(b.chunks_exact(16)) {
        for i in 0..16 {
            sum[i] += a[i] * b[i];
        }
    }
    sum.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bundle::scale_space::blurred;

    /// Noise of several scales.
    fn texture(width: usize, height: usize) -> Plane {
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1u32 << 24) as f32 - 0.5
        };
        let white = Plane::from_fn(width, height, |_, _| noise());
        let (fine, coarse) = (blurred(&white, 1.0), blurred(&white, 4.0));
        Plane::from_fn(width, height, |c, r| 0.5 + 0.8 * fine.at(c, r) + 4.0 * coarse.at(c, r))
    }

    #[test]
    fn keypoints_turn_with_the_image() {
        let image = texture(160, 140);
        // A quarter turn: (col, row) goes to (row, width - 1 - col).
        let turned = Plane::from_fn(140, 160, |c, r| image.at(159 - r, c));
        let (a, b) = (detect(&image), detect(&turned));
        assert!(a.len() > 100, "{}", a.len());
        let matched = a
            .iter()
            .filter(|k| {
                let there = Pixel::new(k.px.row, 159.0 - k.px.col);
                b.iter()
                    .any(|q| q.px.distance(there) < 0.3 && similarity(&k.descriptor, &q.descriptor) > 0.95)
            })
            .count();
        assert!(matched * 10 > a.len() * 9, "{matched} of {}", a.len());
    }

    #[test]
    fn there_are_no_keypoints_near_missing_pixels() {
        let mut image = texture(128, 128);
        for row in 0..128 {
            image.data[row * 128..row * 128 + 40].fill(f32::NAN);
        }
        let found = detect(&image);
        assert!(!found.is_empty() && found.iter().all(|k| k.px.col > 49.0));
    }
}
