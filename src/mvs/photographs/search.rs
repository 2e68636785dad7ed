//! The search of a view's inverse depths: which planes are tested, and the matching.

use super::planes::{DepthPlanes, Transfer};
use crate::io::Grid2;
use crate::mvs::block_ranges::{BLOCKS, BlockRanges};
use crate::mvs::image::MatchImage;
use crate::mvs::plane_sweep::MAX_VOLUME;
use crate::mvs::ray_map::RayMap;
use crate::mvs::reference_view::ReferenceView;
use crate::perspective::PinholeCamera;
use crate::stats::quantile;
use glam::DVec2;
use std::ops::Range;

/// Distance between planes: at low resolution, pixels of the source view in which it is the median one, and at full resolution,
/// pixels of that in which it is largest.
const COARSE_STEP_PX: f64 = 1.0;
const STEP_PX: f64 = 0.75;
/// Greatest number of planes of the search at low resolution.
const MOST_PLANES: f64 = 256.0;
/// Pixels of a view, along each side, at which the planes are laid out.
const SAMPLES: usize = 8;
/// The nearest plane is the last one at which this share of the view is still seen by two source views, or by the only one.
const LEAST_SEEN: f64 = 0.05;
/// Depths that are tried for the nearest plane: the longest baseline times two to the powers of these, in quarters.
const NEAREST_QUARTERS: Range<i32> = -24..40;
/// Share of the displacements of points, by a difference of inverse depth, that are smaller than those that the step follows.
const DISPLACEMENT: f64 = 0.9;
/// Planes of the search at low resolution that are tested on both sides of its surface.
const MARGIN_PLANES: f64 = 2.0;
/// Pixels of low resolution around a block whose surface is its own too.
const AROUND_PX: usize = 3;
/// Share of the lowest and of the highest inverse depths around a block that are taken for errors.
const OUTLIERS: f64 = 0.03;
/// Inverse depths of neighbouring pixels that differ by more than this many pixels' worth lie on two surfaces.
const DISCONTINUITY_PX: f64 = 1.0;

/// At which resolution a view is matched.
#[derive(Clone, Copy, Debug)]
pub(super) enum Resolution {
    /// That of the search everywhere.
    Low,
    /// That of the maps.
    Full,
}

/// A view and the source views that it is matched with.
pub(super) struct Search<'a> {
    view: usize,
    source_indices: &'a [usize],
    image: &'a MatchImage<PinholeCamera>,
    sources: Vec<&'a MatchImage<PinholeCamera>>,
    /// The greatest inverse depth.
    nearest: f64,
    /// Difference of inverse depth that moves a point by one pixel, in the source view where it moves farthest, and in the median of
    /// the source views.
    value_per_px: f64,
    median_value_per_px: f64,
}

impl<'a> Search<'a> {
    /// The search of a view with its source views; none if none of these sees what the view sees.
    pub fn new(
        images: &'a [MatchImage<PinholeCamera>],
        view: usize,
        source_indices: &'a [usize],
    ) -> Option<Self> {
        let image = &images[view];
        let sources: Vec<_> = source_indices.iter().map(|j| &images[*j]).collect();
        let pairs = sources.iter().map(|s| Pair::new(&image.camera, &s.camera));
        let pairs: Vec<Pair> = pairs.collect();
        let nearest = nearest(&image.camera, &pairs)?;
        let px_per_value = pairs.iter().filter_map(|pair| pair.px_per_value(&image.camera, nearest));
        let px_per_value: Vec<f64> = px_per_value.filter(|v| v.is_normal()).collect();
        let value_per_px = quantile(px_per_value.clone(), 1.0)?.recip();
        let median_value_per_px = quantile(px_per_value, 0.5)?.recip();
        Some(Self { view, source_indices, image, sources, nearest, value_per_px, median_value_per_px })
    }

    /// What the consistency check needs to know of the view: at low resolution maps are as exact as the planes are close.
    pub fn reference(&self, resolution: Resolution) -> ReferenceView {
        let value_per_px = match resolution {
            Resolution::Low => self.value_per_px.max(self.coarse_planes().0),
            Resolution::Full => self.value_per_px,
        };
        ReferenceView {
            view: self.view,
            sources: self.source_indices.to_vec(),
            value_per_px,
            discontinuity: (DISCONTINUITY_PX * value_per_px) as f32,
        }
    }

    /// Distance between the planes of a search everywhere, and their number.
    fn coarse_planes(&self) -> (f64, usize) {
        let step = (COARSE_STEP_PX * self.median_value_per_px).max(self.nearest / MOST_PLANES);
        (step, (self.nearest / step).ceil() as usize + 1)
    }

    /// The inverse depths of the pixels, searched from infinity to the nearest plane.
    pub fn everywhere(&self) -> RayMap {
        let (step, planes) = self.coarse_planes();
        let blocks = BLOCKS.count(self.size());
        self.matched(step, vec![0..planes; blocks.0 * blocks.1])
    }

    /// The inverse depths of the pixels, searched near those that were found at a resolution lower by a factor. Far from
    /// these nothing is searched.
    pub fn near(&self, found: &RayMap, factor: usize) -> RayMap {
        let step = STEP_PX * self.value_per_px;
        let margin = MARGIN_PLANES * COARSE_STEP_PX * self.median_value_per_px * factor as f64;
        let (across, down) = BLOCKS.count(self.size());
        let Grid2 { width, height, .. } = found.value;
        let cells = |block: usize, side: usize, around: usize, count: usize| {
            let first = (block * side / factor).saturating_sub(around);
            first..(((block + 1) * side).div_ceil(factor) + around).min(count)
        };
        let range_around = |block: usize, [right, down]: [usize; 2]| {
            let columns = cells(block % across, BLOCKS.columns, right, width);
            let rows = cells(block / across, BLOCKS.rows, down, height);
            let values = rows.flat_map(|row| &found.value.row(row)[columns.clone()]);
            let values: Vec<f64> = values.filter(|v| !v.is_nan()).map(|v| f64::from(*v)).collect();
            let (low, high) = quantile(values.clone(), OUTLIERS).zip(quantile(values, 1.0 - OUTLIERS))?;
            let first = ((low - margin) / step).max(0.0) as usize;
            Some(first..((high + margin) / step).ceil() as usize + 1)
        };
        // A block in which nothing was found may go on as the blocks around it.
        let blocks_around = [BLOCKS.columns.div_ceil(factor), BLOCKS.rows.div_ceil(factor)];
        let range = |block: usize| {
            let near = range_around(block, [AROUND_PX; 2]);
            near.or_else(|| range_around(block, blocks_around)).unwrap_or(0..0)
        };
        self.matched(step, (0..across * down).map(range).collect())
    }

    fn size(&self) -> (usize, usize) {
        (self.image.gray.width, self.image.gray.height)
    }

    fn matched(&self, step: f64, ranges: Vec<Range<usize>>) -> RayMap {
        let blocks = BlockRanges::new(self.size(), ranges);
        RayMap::matched(self.image, &self.sources, &blocks, MAX_VOLUME, |strip, _| {
            let transfers = self.sources.iter().map(|s| Transfer::new(&strip.camera, &s.camera)).collect();
            DepthPlanes { transfers, step }
        })
    }
}

/// A reference view and a source view.
struct Pair {
    transfer: Transfer,
    baseline: f64,
    /// Columns and rows of the source view.
    size: DVec2,
}

impl Pair {
    fn new(reference: &PinholeCamera, source: &PinholeCamera) -> Self {
        Self {
            transfer: Transfer::new(reference, source),
            baseline: reference.center.distance(source.center),
            size: DVec2::new(source.size.0 as f64, source.size.1 as f64),
        }
    }

    /// Where the source view sees a pixel at an inverse depth, if it is in its image.
    fn place(&self, px: DVec2, inverse_depth: f64) -> Option<DVec2> {
        let place = self.transfer.place(px, inverse_depth)?;
        (place.cmpge(DVec2::ZERO).all() && place.cmple(self.size - 1.0).all()).then_some(place)
    }

    /// By how many pixels points move in the source view for a difference of inverse depth of one.
    fn px_per_value(&self, reference: &PinholeCamera, nearest: f64) -> Option<f64> {
        let small = 1e-3 * nearest;
        let moved = [0.1, 0.3, 0.5, 0.8].into_iter().flat_map(|share| {
            samples(reference).filter_map(move |px| {
                let near = self.place(px, share * nearest)?;
                Some(near.distance(self.transfer.place(px, share * nearest + small)?) / small)
            })
        });
        quantile(moved.collect(), DISPLACEMENT)
    }
}

/// Some pixels all over a view.
fn samples(camera: &PinholeCamera) -> impl Iterator<Item = DVec2> {
    let size = DVec2::new(camera.size.0 as f64, camera.size.1 as f64);
    let at = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
    (0..SAMPLES * SAMPLES).map(move |k| size * DVec2::new(at(k % SAMPLES), at(k / SAMPLES)) - 0.5)
}

/// The greatest inverse depth at which a source view still sees a part of the view.
fn nearest(reference: &PinholeCamera, pairs: &[Pair]) -> Option<f64> {
    let longest = pairs.iter().map(|pair| pair.baseline).fold(0.0, f64::max);
    let is_seen = |inverse_depth: &f64| {
        let seen = |px: &DVec2| pairs.iter().filter(|pair| pair.place(*px, *inverse_depth).is_some()).count();
        let seen = |px: &DVec2| seen(px) >= pairs.len().min(2);
        samples(reference).filter(seen).count() as f64 >= LEAST_SEEN * (SAMPLES * SAMPLES) as f64
    };
    let depths = NEAREST_QUARTERS.map(|k| longest * (0.25 * f64::from(k)).exp2());
    depths.map(f64::recip).filter(|w| w.is_finite()).find(is_seen)
}
