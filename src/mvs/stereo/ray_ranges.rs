//! The planes that are tested on the rays of a view's pixels: those near the candidates of the ground that the rays pass.

use super::rays::to_ground;
use crate::frame::{Pixel, SiteBox};
use crate::mvs::image::MatchImage;
use crate::mvs::plane_ranges::{BlockAltitudes, Blocks, PlaneRanges, planes_for};
use crate::mvs::plane_sweep::PlaneSweep;
use rayon::prelude::*;
use std::ops::Range;

/// Blocks of pixels with a common range of planes.
pub(super) const BLOCKS: Blocks = Blocks { columns: 64, rows: 32 };

/// The ranges of planes of the pixels of a view.
pub(super) struct RayRanges {
    size: (usize, usize),
    /// Height of the first plane above the ground, metres.
    pub low_m: f32,
    /// Of each block, row by row.
    ranges: Vec<Range<usize>>,
}

impl RayRanges {
    /// The ranges of an image's pixels, of planes `step_m` metres apart. Nothing is tested where no two views see the ground.
    pub fn new(sweep: &PlaneSweep, image: &MatchImage, step_m: f64) -> Self {
        let size = (image.gray.width, image.gray.height);
        let across = BLOCKS.count(size).0;
        let of_block = |block: usize| {
            let at = |k: usize, side: usize, n: usize| {
                let (first, end) = (k * side, ((k + 1) * side).min(n));
                [first as f64, 0.5 * (first + end - 1) as f64, (end - 1) as f64]
            };
            let columns = at(block % across, BLOCKS.columns, size.0);
            let rows = at(block / across, BLOCKS.rows, size.1);
            let pixels = rows.iter().flat_map(|row| columns.map(|col| Pixel::new(col, *row)));
            let part = |altitude: f64| -> SiteBox {
                let empty = (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY);
                let places = pixels.clone().map(|px| image.camera.localize(px, altitude));
                places.fold(empty, |(w, s, e, n), [x, y]| (w.min(x), s.min(y), e.max(x), n.max(y)))
            };
            let ground = pixels.clone().map(|px| to_ground(sweep, &image.camera, px) as f32);
            let candidates = sweep.candidates.as_ref();
            BlockAltitudes {
                tested: candidates.and_then(|candidates| candidates.altitudes(part)),
                ground: BlockAltitudes::bounds(ground),
            }
        };
        let blocks: Vec<_> = (0..across * BLOCKS.count(size).1).into_par_iter().map(of_block).collect();
        let (low_m, _, ranges) = planes_for(&blocks, step_m as f32);
        Self { size, low_m, ranges }
    }

    /// The ranges of some rows of blocks, as those of an image of their own.
    pub fn of_rows(&self, rows: Range<usize>) -> PlaneRanges {
        let across = BLOCKS.count(self.size).0;
        let height = (rows.end * BLOCKS.rows).min(self.size.1) - rows.start * BLOCKS.rows;
        let ranges = &self.ranges[rows.start * across..rows.end * across];
        PlaneRanges::of_blocks((self.size.0, height), BLOCKS, ranges)
    }

    /// Number of planes of all pixels of a row of blocks.
    pub fn volume(&self, row: usize) -> usize {
        let across = BLOCKS.count(self.size).0;
        let widths = (0..across).map(|k| BLOCKS.columns.min(self.size.0 - k * BLOCKS.columns));
        let of_row = self.ranges[row * across..(row + 1) * across].iter().zip(widths);
        BLOCKS.rows * of_row.map(|(range, width)| range.len() * width).sum::<usize>()
    }

    /// Number of rows of blocks.
    pub fn rows(&self) -> usize {
        BLOCKS.count(self.size).1
    }
}
