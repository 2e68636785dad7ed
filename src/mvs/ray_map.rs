//! A value for every pixel of a view that says where the surface lies on its ray, by semi-global matching: an altitude in
//! images of satellites, an inverse depth in photographs.

use super::block_ranges::{BLOCKS, BlockRanges};
use super::image::{MatchImage, PixelCamera};
use super::plane_ranges::PlaneRanges;
use super::ray_costs::{RayCosts, Rays};
use super::semiglobal::{self, P2, Penalties};
use crate::io::{Grid2, Window};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
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

/// Where the surface lies on the rays of a view's pixels.
#[derive(Serialize, Deserialize)]
pub(super) struct RayMap {
    /// An altitude (site metres) or an inverse depth; NaN where there is none.
    pub value: Grid2,
    /// Correlation with the source views, above 0 and up to 1 where there is a value.
    pub score: Grid2,
}

impl RayMap {
    /// Matches a view with source views in strips whose cost volumes have at most `most` entries. `rays` gives the rays of a strip
    /// with its ranges of planes.
    pub fn matched<C: PixelCamera, R: Rays>(
        image: &MatchImage<C>,
        sources: &[&MatchImage<C>],
        blocks: &BlockRanges,
        most: f64,
        rays: impl Fn(&MatchImage<C>, &PlaneRanges) -> R,
    ) -> Self {
        let Grid2 { width, height, .. } = image.gray;
        let unknown = |value| Grid2::filled(width, height, value);
        let mut map = Self { value: unknown(f32::NAN), score: unknown(0.0) };
        for (own, matched) in blocks.strips(most) {
            let rows = |blocks: &Range<usize>| {
                (blocks.start * BLOCKS.rows).min(height)..(blocks.end * BLOCKS.rows).min(height)
            };
            let ranges = blocks.of_rows(matched.clone());
            let (own, matched) = (rows(&own), rows(&matched));
            let strip = image.cropped(Window { col: 0, row: matched.start, width, height: matched.len() });
            let rays = rays(&strip, &ranges);
            let costs = RayCosts::new(&strip, sources, &rays, &ranges);
            map.copy_rows(own, &Self::optimized(&strip, &rays, &costs), matched.start);
        }
        map
    }

    /// Forgets the values of pixels at which the surface cannot lie.
    pub fn keep(&mut self, is_possible: impl Fn(usize, f32) -> bool + Sync) {
        let pixels = self.value.data.par_iter_mut().zip(&mut self.score.data).enumerate();
        let known = pixels.filter(|(_, (value, _))| !value.is_nan());
        known
            .filter(|(pixel, (value, _))| !is_possible(*pixel, **value))
            .for_each(|(_, (value, score))| (*value, *score) = (f32::NAN, 0.0));
    }

    /// The values of least cost after semi-global aggregation, interpolated between planes by a parabola. Pixels whose best plane
    /// is the first or the last have no value, because the true one may lie beyond.
    fn optimized<C>(image: &MatchImage<C>, rays: &impl Rays, volume: &RayCosts) -> Self {
        let Grid2 { width, height, .. } = image.gray;
        let p2 = p2_penalties(&image.gray, image.std_dev);
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
            (rays.value(i, plane), 1.0 - f32::from(costs[k]) / RayCosts::UNCORRELATED)
        };
        let found: Vec<(f32, f32)> = (0..width * height).into_par_iter().map(best).collect();
        let (value, score) = found.into_iter().unzip();
        let raster = |data| Grid2 { width, height, data };
        Self { value: raster(value), score: raster(score) }
    }

    /// Copies the rows `rows` of this map from `strip`, whose first row is row `from` of this map.
    fn copy_rows(&mut self, rows: Range<usize>, strip: &Self, from: usize) {
        let width = self.value.width;
        let (to, of) =
            (rows.start * width..rows.end * width, (rows.start - from) * width..(rows.end - from) * width);
        self.value.data[to.clone()].copy_from_slice(&strip.value.data[of.clone()]);
        self.score.data[to].copy_from_slice(&strip.score.data[of]);
    }
}

/// The penalty P2 of each pixel.
fn p2_penalties(gray: &Grid2, std_dev: f64) -> Vec<u16> {
    let halving_edge = P2_HALVING_EDGE * std_dev as f32;
    let penalty = |i: usize| {
        let (col, row) = ((i % gray.width) as i64, (i / gray.width) as i64);
        let neighbours = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|(c, r)| gray.get(col + c, row + r));
        // `max` ignores NaN.
        let edge = neighbours.into_iter().fold(0.0, |edge: f32, v| edge.max((v - gray.data[i]).abs()));
        (P2_RANGE.end / (1.0 + edge / halving_edge)).max(P2_RANGE.start) as u16
    };
    (0..gray.data.len()).into_par_iter().map(penalty).collect()
}
