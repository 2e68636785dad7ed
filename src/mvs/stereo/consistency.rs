//! The consistency check between the altitude maps of the views, and the removal of noise.

use super::altitude_map::AltitudeMap;
use super::reference::ReferenceView;
use crate::frame::{Pixel, Point};
use crate::io::Grid2;
use crate::mvs::image::MatchImage;

/// Largest difference to the altitude in a source view's map that confirms an altitude, pixels' worth of altitude.
const TOLERANCE_PX: f64 = 1.0;
/// Connected parts of fewer pixels are removed.
const MIN_PART_PX: usize = 40;
/// Radius of the windows over which altitudes are smoothed, pixels.
const SMOOTHING_RADIUS: i64 = 2;
/// Scale of the weights in these windows: an altitude that differs from the central one by this many pixels'
/// worth of altitude has a quarter of the weight.
const SMOOTHING_PX: f64 = 1.0;

/// The maps, smoothed, without the altitudes that no source view's map confirms.
pub(super) fn consistent(
    images: &[MatchImage],
    maps: &[AltitudeMap],
    references: &[ReferenceView],
) -> Vec<AltitudeMap> {
    let map_of = |view: usize| references.iter().position(|p| p.view == view);
    let checked = |(map, own): (&AltitudeMap, &ReferenceView)| {
        let camera = &images[own.view].camera;
        let sources: Vec<(&MatchImage, &Grid2, f32)> = own
            .sources
            .iter()
            .filter_map(|view| {
                let k = map_of(*view)?;
                let tolerance = TOLERANCE_PX * own.metres_per_px.max(references[k].metres_per_px);
                Some((&images[*view], &maps[k].altitude, tolerance as f32))
            })
            .collect();
        let mut altitude = Grid2::from_rows(map.altitude.width, map.altitude.height, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let z = map.altitude.at(col, row);
                let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), f64::from(z));
                let agrees = |(image, altitude, tolerance): &(&MatchImage, &Grid2, f32)| {
                    let px = image.camera.project(Point::new(x, y, f64::from(z)));
                    let there = altitude.get(px.col.round() as i64, px.row.round() as i64);
                    (there - z).abs() <= *tolerance
                };
                *out = if sources.iter().any(agrees) { z } else { f32::NAN };
            }
        });
        for _ in 0..2 {
            altitude = smoothed(&altitude, (SMOOTHING_PX * own.metres_per_px) as f32);
        }
        remove_small_parts(&mut altitude, own.discontinuity_m);
        AltitudeMap { altitude, score: map.score.clone() }
    };
    maps.iter().zip(references).map(checked).collect()
}

/// Weighted means over windows. An altitude that differs from the central one by `scale` (metres) has a
/// quarter of its weight.
fn smoothed(altitude: &Grid2, scale: f32) -> Grid2 {
    Grid2::from_rows(altitude.width, altitude.height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            let z = altitude.at(col, row);
            *out = z;
            if z.is_nan() {
                continue;
            }
            let (mut sum, mut total) = (0.0f32, 0.0f32);
            for r in -SMOOTHING_RADIUS..=SMOOTHING_RADIUS {
                for c in -SMOOTHING_RADIUS..=SMOOTHING_RADIUS {
                    let d = altitude.get(col as i64 + c, row as i64 + r) - z;
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

/// Removes connected parts of fewer than [`MIN_PART_PX`] pixels. Neighbours are connected if their altitudes
/// differ by at most `max_step_m` metres.
fn remove_small_parts(altitude: &mut Grid2, max_step_m: f32) {
    let (width, height) = (altitude.width, altitude.height);
    let mut seen = vec![false; width * height];
    let mut part = Vec::new();
    for start in 0..width * height {
        if seen[start] || altitude.data[start].is_nan() {
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
                if !seen[j] && (altitude.data[j] - altitude.data[i]).abs() <= max_step_m {
                    seen[j] = true;
                    part.push(j);
                }
            }
        }
        if part.len() < MIN_PART_PX {
            part.iter().for_each(|i| altitude.data[*i] = f32::NAN);
        }
    }
}
