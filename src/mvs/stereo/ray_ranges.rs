//! The planes that are tested on the rays of a view's pixels: those near the candidates of the ground that the rays pass.

use super::rays::to_ground;
use crate::frame::{Pixel, SiteBox};
use crate::mvs::block_ranges::{BLOCKS, BlockRanges};
use crate::mvs::image::MatchImage;
use crate::mvs::plane_ranges::{BlockAltitudes, planes_for};
use crate::mvs::plane_sweep::PlaneSweep;
use rayon::prelude::*;

/// The ranges of planes of the pixels of a view.
pub(super) struct RayRanges {
    /// Height of the first plane above the ground, metres.
    pub low_m: f32,
    /// The planes of each block.
    pub blocks: BlockRanges,
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
        Self { low_m, blocks: BlockRanges::new(size, ranges) }
    }
}
