//! An altitude for every pixel of a view, and which of them other views confirm.

use super::Partners;
use super::rays::Rays;
use super::volume::CostVolume;
use crate::frame::{Pixel, Point};
use crate::io::Grid2;
use crate::mvs::correlation::MatchImage;
use crate::mvs::semiglobal::{self, Jump, Steps};
use rayon::prelude::*;
use std::ops::Range;

/// Cost of a step of one plane between neighbours, of the 127 for no correlation.
const STEP: u16 = 30;
/// Cost of a larger jump: in even parts of an image, and at its strongest edges, where surfaces end.
const JUMP: Range<f32> = 40.0..150.0;
/// Difference to a neighbouring pixel, standard deviations of the image, that halves the cost of a jump.
const EDGE: f32 = 0.2;
/// Another view's altitude confirms one that is no further away, pixels.
const TOLERANCE_PX: f64 = 1.0;
/// Connected parts of fewer pixels are no surfaces; neighbours connect up to a step.
const SMALLEST_PART: usize = 40;
/// Altitudes are averaged over windows of this half side, twice; what lies so far away, pixels, counts a quarter.
const SMOOTHED: i64 = 2;
const SMOOTHED_PX: f64 = 1.0;

/// Altitudes of a view's pixels.
pub(super) struct AltitudeMap {
    /// Site metres; NaN where there is none.
    pub altitude: Grid2,
    /// Correlation with the other views, more than 0 to 1 where there is an altitude.
    pub score: Grid2,
}

impl AltitudeMap {
    /// A map that knows nothing.
    pub fn unknown(width: usize, height: usize) -> Self {
        Self { altitude: Grid2::filled(width, height, f32::NAN), score: Grid2::filled(width, height, 0.0) }
    }

    /// The altitudes of least cost, between planes by a parabola. The first and the last plane are no answers: what is
    /// looked for may lie beyond.
    pub fn pick(image: &MatchImage, rays: &Rays, volume: &CostVolume) -> Self {
        let Grid2 { width, height, .. } = image.gray;
        let planes = volume.planes;
        let jumps = jumps(image);
        let steps = Steps { step: STEP, jump: Jump::OfCell(&jumps) };
        let sums = semiglobal::aggregate(&volume.costs, width, planes, steps);
        let best = |i: usize| {
            let (costs, sums) = (volume.pixel(i), &sums[i * planes..(i + 1) * planes]);
            let k = (0..planes).min_by_key(|k| sums[*k]).unwrap_or(0);
            // Where the views have nothing in common, or one of them sees nothing, neighbours alone have decided.
            if f32::from(costs[k]) >= CostVolume::UNLIKE || k == 0 || k + 1 == planes {
                return (f32::NAN, 0.0);
            }
            let [a, b, c] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
            let between = 0.5 * (a - c) / (a - 2.0 * b + c).max(1.0);
            let altitude = rays.lowest.data[i] + rays.step_m * (k as f32 + between);
            (altitude, 1.0 - f32::from(costs[k]) / CostVolume::UNLIKE)
        };
        let picked: Vec<(f32, f32)> = (0..width * height).into_par_iter().map(best).collect();
        let (altitude, score) = picked.into_iter().unzip();
        let plane = |data| Grid2 { width, height, data };
        Self { altitude: plane(altitude), score: plane(score) }
    }

    /// Takes rows of a map whose first row is this one's row `from`.
    pub fn take_rows(&mut self, rows: Range<usize>, strip: &Self, from: usize) {
        let width = self.altitude.width;
        let (to, of) =
            (rows.start * width..rows.end * width, (rows.start - from) * width..(rows.end - from) * width);
        self.altitude.data[to.clone()].copy_from_slice(&strip.altitude.data[of.clone()]);
        self.score.data[to].copy_from_slice(&strip.score.data[of]);
    }
}

/// What a jump costs at each pixel.
fn jumps(image: &MatchImage) -> Vec<u16> {
    let gray = &image.gray;
    let halved_at = EDGE * image.contrast as f32;
    let jump = |i: usize| {
        let (col, row) = ((i % gray.width) as i64, (i / gray.width) as i64);
        let beside = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(c, r)| gray.get(col + c, row + r));
        // NaN is never the greater.
        let step = beside.into_iter().fold(0.0, |step: f32, v| step.max((v - gray.data[i]).abs()));
        (JUMP.end / (1.0 + step / halved_at)).max(JUMP.start) as u16
    };
    (0..gray.data.len()).into_par_iter().map(jump).collect()
}

/// The maps without what no other view's map confirms, smoothed.
pub(super) fn confirmed(
    images: &[MatchImage],
    maps: &[AltitudeMap],
    partners: &[Partners],
) -> Vec<AltitudeMap> {
    let map_of = |view: usize| partners.iter().position(|p| p.view == view);
    let confirm = |(map, own): (&AltitudeMap, &Partners)| {
        let camera = &images[own.view].camera;
        let others: Vec<(&MatchImage, &Grid2, f32)> = own
            .others
            .iter()
            .filter_map(|view| {
                let k = map_of(*view)?;
                let tolerance = TOLERANCE_PX * own.px_m.max(partners[k].px_m);
                Some((&images[*view], &maps[k].altitude, tolerance as f32))
            })
            .collect();
        let mut altitude = Grid2::from_rows(map.altitude.width, map.altitude.height, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let z = map.altitude.at(col, row);
                let [x, y] = camera.place_at(Pixel::new(col as f64, row as f64), f64::from(z));
                let agrees = |(image, altitude, tolerance): &(&MatchImage, &Grid2, f32)| {
                    let px = image.camera.project(Point::new(x, y, f64::from(z)));
                    let there = altitude.get(px.col.round() as i64, px.row.round() as i64);
                    (there - z).abs() <= *tolerance
                };
                *out = if others.iter().any(agrees) { z } else { f32::NAN };
            }
        });
        for _ in 0..2 {
            altitude = smoothed(&altitude, (SMOOTHED_PX * own.px_m) as f32);
        }
        remove_small_parts(&mut altitude, own.step_m);
        AltitudeMap { altitude, score: map.score.clone() }
    };
    maps.iter().zip(partners).map(confirm).collect()
}

/// Means over windows, in which altitudes count the less the further they lie from the central one's; at `far`, metres,
/// a quarter.
fn smoothed(altitude: &Grid2, far: f32) -> Grid2 {
    Grid2::from_rows(altitude.width, altitude.height, |row, line| {
        for (col, out) in line.iter_mut().enumerate() {
            let z = altitude.at(col, row);
            *out = z;
            if z.is_nan() {
                continue;
            }
            let (mut sum, mut total) = (0.0f32, 0.0f32);
            for r in -SMOOTHED..=SMOOTHED {
                for c in -SMOOTHED..=SMOOTHED {
                    let d = altitude.get(col as i64 + c, row as i64 + r) - z;
                    if !d.is_nan() {
                        let weight = (1.0 + (d / far).powi(2)).powi(-2);
                        (sum, total) = (sum + weight * d, total + weight);
                    }
                }
            }
            *out += sum / total;
        }
    })
}

/// Makes NaN what is connected with too few pixels; more than `step_m` between neighbours does not connect.
fn remove_small_parts(altitude: &mut Grid2, step_m: f32) {
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
            let beside = [
                (col > 0).then(|| i - 1),
                (col + 1 < width).then(|| i + 1),
                (row > 0).then(|| i - width),
                (row + 1 < height).then(|| i + width),
            ];
            for j in beside.into_iter().flatten() {
                // NaN is never near.
                if !seen[j] && (altitude.data[j] - altitude.data[i]).abs() <= step_m {
                    seen[j] = true;
                    part.push(j);
                }
            }
        }
        if part.len() < SMALLEST_PART {
            part.iter().for_each(|i| altitude.data[*i] = f32::NAN);
        }
    }
}
