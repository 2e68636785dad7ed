//! An altitude for every pixel of a view, by semi-global matching.

use super::ray_costs::RayCosts;
use super::rays::Rays;
use crate::io::Grid2;
use crate::mvs::image::MatchImage;
use crate::mvs::semiglobal::{self, P2, Penalties};
use rayon::prelude::*;
use std::ops::Range;

/// Penalty of semi-global matching for a difference of one plane between neighbouring pixels, in the unit of
/// [`RayCosts`], where 127 stands for a correlation of 0.
const P1: u16 = 30;
/// Penalty for a larger difference: from its value at the strongest edges of the image, where surfaces end,
/// to its value in uniform parts.
const P2_RANGE: Range<f32> = 40.0..150.0;
/// Difference of gray value to a neighbouring pixel, in standard deviations of the image, at which the
/// penalty P2 is halved.
const P2_HALVING_EDGE: f32 = 0.2;

/// Altitudes of the pixels of a view.
pub(super) struct AltitudeMap {
    /// Site metres; NaN where there is none.
    pub altitude: Grid2,
    /// Correlation with the source views, above 0 and up to 1 where there is an altitude.
    pub score: Grid2,
}

impl AltitudeMap {
    /// A map without any altitude.
    pub fn unknown(width: usize, height: usize) -> Self {
        Self { altitude: Grid2::filled(width, height, f32::NAN), score: Grid2::filled(width, height, 0.0) }
    }

    /// The altitudes of least cost after semi-global aggregation, interpolated between planes by a parabola.
    /// Pixels whose best plane is the first or the last have no altitude, because the true one may lie
    /// beyond.
    pub fn optimized(image: &MatchImage, rays: &Rays, volume: &RayCosts) -> Self {
        let Grid2 { width, height, .. } = image.gray;
        let p2 = p2_penalties(image);
        let penalties = Penalties { p1: P1, p2: P2::PerCell(&p2) };
        let sums = semiglobal::aggregate(&volume.costs, volume.ranges, penalties);
        let best = |i: usize| {
            let entries = volume.ranges.entries(i..i + 1);
            let (costs, sums) = (&volume.costs[entries.clone()], &sums[entries]);
            let k = (0..sums.len()).min_by_key(|k| sums[*k]).unwrap_or(0);
            // Without correlation, or where no source view sees the point, only the neighbours have
            // determined the plane.
            if k == 0 || k + 1 == sums.len() || f32::from(costs[k]) >= RayCosts::UNCORRELATED {
                return (f32::NAN, 0.0);
            }
            let [a, b, c] = [sums[k - 1], sums[k], sums[k + 1]].map(f32::from);
            let fraction = 0.5 * (a - c) / (a - 2.0 * b + c).max(1.0);
            let plane = (volume.ranges.planes(i).start + k) as f32 + fraction;
            let altitude = rays.lowest.data[i] + rays.step_m * plane;
            (altitude, 1.0 - f32::from(costs[k]) / RayCosts::UNCORRELATED)
        };
        let found: Vec<(f32, f32)> = (0..width * height).into_par_iter().map(best).collect();
        let (altitude, score) = found.into_iter().unzip();
        let raster = |data| Grid2 { width, height, data };
        Self { altitude: raster(altitude), score: raster(score) }
    }

    /// Forgets the altitudes of pixels at which the surface cannot lie.
    pub fn keep(&mut self, is_possible: impl Fn(usize, f32) -> bool + Sync) {
        let pixels = self.altitude.data.par_iter_mut().zip(&mut self.score.data).enumerate();
        let known = pixels.filter(|(_, (altitude, _))| !altitude.is_nan());
        known
            .filter(|(pixel, (altitude, _))| !is_possible(*pixel, **altitude))
            .for_each(|(_, (altitude, score))| (*altitude, *score) = (f32::NAN, 0.0));
    }

    /// Copies the rows `rows` of this map from `strip`, whose first row is row `from` of this map.
    pub fn copy_rows(&mut self, rows: Range<usize>, strip: &Self, from: usize) {
        let width = self.altitude.width;
        let (to, of) =
            (rows.start * width..rows.end * width, (rows.start - from) * width..(rows.end - from) * width);
        self.altitude.data[to.clone()].copy_from_slice(&strip.altitude.data[of.clone()]);
        self.score.data[to].copy_from_slice(&strip.score.data[of]);
    }
}

/// The penalty P2 of each pixel.
fn p2_penalties(image: &MatchImage) -> Vec<u16> {
    let gray = &image.gray;
    let halving_edge = P2_HALVING_EDGE * image.std_dev as f32;
    let penalty = |i: usize| {
        let (col, row) = ((i % gray.width) as i64, (i / gray.width) as i64);
        let neighbours = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(c, r)| gray.get(col + c, row + r));
        // `max` ignores NaN.
        let edge = neighbours.into_iter().fold(0.0, |edge: f32, v| edge.max((v - gray.data[i]).abs()));
        (P2_RANGE.end / (1.0 + edge / halving_edge)).max(P2_RANGE.start) as u16
    };
    (0..gray.data.len()).into_par_iter().map(penalty).collect()
}
