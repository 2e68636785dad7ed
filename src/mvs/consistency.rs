//! The consistency check between the maps of the views, and the removal of noise.

use super::image::{MatchImage, RayCamera};
use super::ray_map::RayMap;
use super::reference_view::ReferenceView;
use crate::frame::Pixel;
use crate::io::Grid2;
use rayon::prelude::*;

/// Largest difference to the value in a source view's map that confirms a value, pixels' worth.
const TOLERANCE_PX: f64 = 1.0;
/// Radius of the windows over which values are smoothed, pixels.
const SMOOTHING_RADIUS: i64 = 2;
/// Scale of the weights in these windows: a value that differs from the central one by this many pixels' worth has a quarter of
/// the weight.
const SMOOTHING_PX: f64 = 1.0;

/// What a map must fulfil.
#[derive(Clone, Copy, Debug)]
pub(super) struct Check {
    /// Number of source views whose maps must confirm a value: of a view with few source views half of these at least.
    pub confirmations: usize,
    /// Connected parts of fewer pixels are removed.
    pub least_part_px: usize,
}

/// The maps, smoothed, without the values that too few source views' maps confirm, and without small parts.
pub(super) fn consistent<C: RayCamera>(
    images: &[MatchImage<C>],
    maps: &[RayMap],
    references: &[ReferenceView],
    check: Check,
) -> Vec<RayMap> {
    let mut place_of = vec![None; images.len()];
    references.iter().enumerate().for_each(|(k, reference)| place_of[reference.view] = Some(k));
    let checked = |(map, own): (&RayMap, &ReferenceView)| {
        let camera = &images[own.view].camera;
        let source = |view: &usize| {
            let k = place_of[*view]?;
            let tolerance = TOLERANCE_PX * own.value_per_px.max(references[k].value_per_px);
            Some((&images[*view].camera, &maps[k].value, tolerance as f32))
        };
        let sources: Vec<(&C, &Grid2, f32)> = own.sources.iter().filter_map(source).collect();
        let needed = check.confirmations.min(sources.len().div_ceil(2)).max(1);
        let mut value = Grid2::from_rows(map.value.width, map.value.height, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let own = map.value.at(col, row);
                *out = f32::NAN;
                if own.is_nan() {
                    continue;
                }
                let p = camera.point(Pixel::new(col as f64, row as f64), f64::from(own));
                let agrees = |(other, values, tolerance): &&(&C, &Grid2, f32)| {
                    let Some((px, expected)) = other.sees(p) else { return false };
                    let there = values.get(px.col.round() as i64, px.row.round() as i64);
                    (there - expected as f32).abs() <= *tolerance
                };
                if sources.iter().filter(agrees).take(needed).count() == needed {
                    *out = own;
                }
            }
        });
        for _ in 0..2 {
            value = smoothed(&value, (SMOOTHING_PX * own.value_per_px) as f32);
        }
        remove_small_parts(&mut value, own.discontinuity, check.least_part_px);
        RayMap { value, score: map.score.clone() }
    };
    maps.par_iter().zip(references).map(checked).collect()
}

/// Weighted means over windows. A value that differs from the central one by `scale` has a quarter of its weight.
fn smoothed(values: &Grid2, scale: f32) -> Grid2 {
    Grid2::from_rows(values.width, values.height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            let z = values.at(col, row);
            *out = z;
            if z.is_nan() {
                continue;
            }
            let (mut sum, mut total) = (0.0f32, 0.0f32);
            for r in -SMOOTHING_RADIUS..=SMOOTHING_RADIUS {
                for c in -SMOOTHING_RADIUS..=SMOOTHING_RADIUS {
                    let d = values.get(col as i64 + c, row as i64 + r) - z;
                    if !d.is_nan() {
                        let weight = (1.0 + (d / scale).powi(2)).powi(-2);
                        (sum, total) = (sum + weight * d, total + weight);
                    }
                }
            }
            *out += sum / total;
        }
    })
}

/// Removes connected parts of fewer than `least_px` pixels. Neighbours are connected if their values
/// differ by at most `max_step`.
fn remove_small_parts(values: &mut Grid2, max_step: f32, least_px: usize) {
    let (width, height) = (values.width, values.height);
    let mut seen = vec![false; width * height];
    let mut part = Vec::new();
    for start in 0..width * height {
        if seen[start] || values.data[start].is_nan() {
            continue;
        }
        part.clear();
        part.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&i) = part.get(next) {
            next += 1;
            let (col, row) = (i % width, i / width);
            let neighbours = [
                (col > 0).then(|| i - 1),
                (col + 1 < width).then(|| i + 1),
                (row > 0).then(|| i - width),
                (row + 1 < height).then(|| i + width),
            ];
            for j in neighbours.into_iter().flatten() {
                // Comparisons with NaN are false.
                if !seen[j] && (values.data[j] - values.data[i]).abs() <= max_step {
                    seen[j] = true;
                    part.push(j);
                }
            }
        }
        if part.len() < least_px {
            part.iter().for_each(|i| values.data[*i] = f32::NAN);
        }
    }
}
