//! Splats through one camera: image ellipses, the tiles they touch, and the gradient's way back.

use super::bands::Band;
use super::block::TILE;
use super::kernel::{GradientSlot, add};
use super::prepare::{ELEMENTS, SortedSplats, SplatBlock, SplatGradient};
use super::{ALPHA_CUT, LOW_PASS_PX2};
use crate::camera::{CameraKernel, Linearized};
use crate::simd::Real;
use crate::simd::{
    MAX_LANES, Simd, SimdKernel, SimdReal, SimdVec, arrays_of_lanes, broadcast_each, set_bits,
};
use std::ops::Range;

/// Ranks that are projected together; fixed, so that sums do not depend on the number of threads.
pub(super) const CHUNK: usize = 128 * MAX_LANES;

/// A camera and the size of its image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameCamera<K> {
    /// The camera.
    pub kernel: K,
    /// Columns of the image, 1 to [`super::MAX_SIDE`].
    pub width: usize,
    /// Rows of the image, 1 to [`super::MAX_SIDE`].
    pub height: usize,
}

impl<K> FrameCamera<K> {
    /// The camera for an image of this size.
    #[must_use]
    pub fn new(camera: impl Into<K>, width: usize, height: usize) -> Self {
        Self { kernel: camera.into(), width, height }
    }
}

/// The ellipse at which a splat's alpha falls to the cut-off; or, of rows, those of several splats.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Footprint<N> {
    /// Centre, pixels.
    pub mean: [N; 2],
    /// Inverse covariance: xx, xy, yy; 1/px².
    pub conic: [N; 3],
    /// Binary logarithm of the opacity.
    pub log2_opacity: N,
    /// Squared Mahalanobis radius of the cut-off.
    pub radius2: N,
    /// SimdVec (from the centre) of the rightmost column at the cut-off.
    pub lean: N,
}

impl<N: Copy> Footprint<N> {
    /// Its numbers, as they are stored.
    #[inline(always)]
    fn numbers(self) -> [N; 8] {
        let Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, lean } = self;
        [u, v, a, b, c, log2_opacity, radius2, lean]
    }

    /// From [`Footprint::numbers`].
    #[inline(always)]
    pub fn of([u, v, a, b, c, log2_opacity, radius2, lean]: [N; 8]) -> Self {
        Self { mean: [u, v], conic: [a, b, c], log2_opacity, radius2, lean }
    }
}

/// A splat that the camera sees.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Seen<T> {
    /// [`Footprint::numbers`].
    pub footprint: [T; 8],
    /// Rank of the splat.
    pub rank: u32,
}

/// The tiles `first..=last` of one band that a footprint of a chunk touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// Index of the splat among those that its chunk's camera sees.
    pub splat: u32,
    pub first: u16,
    pub last: u16,
}

/// What a camera sees of a run of ranks, and where it lies.
pub(super) struct Chunk<T> {
    start: usize,
    seen: Vec<Seen<T>>,
    /// Spans sorted by band, within a band by rank.
    spans: Vec<Span>,
    /// Each span's splat: a band reads its own from first to last.
    drawn: Vec<Seen<T>>,
    /// Spans of band `b` are `spans[band_starts[b]..band_starts[b + 1]]`.
    band_starts: Vec<u32>,
    unsorted: Vec<(u32, Span)>,
    /// The derivative by each rank's image position; none where no pixel sees it.
    by_mean: Vec<Option<[T; 2]>>,
}

/// Projects a chunk; a kernel to be compiled with the processor's own rounding and fused instructions.
pub(super) struct Projection<'a, T, K> {
    pub chunk: &'a mut Chunk<T>,
    pub prepared: &'a SortedSplats<T>,
    pub ranks: Range<usize>,
    pub camera: &'a FrameCamera<K>,
}

impl<T: SimdReal, K: CameraKernel<T>> SimdKernel<T> for Projection<'_, T, K> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        self.chunk.project(simd, self.prepared, self.ranks, self.camera);
    }
}

impl<T> Default for Chunk<T> {
    fn default() -> Self {
        Self {
            start: 0,
            seen: Vec::new(),
            spans: Vec::new(),
            drawn: Vec::new(),
            band_starts: Vec::new(),
            unsorted: Vec::new(),
            by_mean: Vec::new(),
        }
    }
}

impl<T: Real> Chunk<T> {
    /// Projects the splats of `ranks`, leaving out those that no pixel sees.
    #[inline(always)]
    fn project<S: Simd<Scalar = T>, K: CameraKernel<T>>(
        &mut self,
        simd: S,
        prepared: &SortedSplats<T>,
        ranks: Range<usize>,
        camera: &FrameCamera<K>,
    ) {
        self.start = ranks.start;
        self.seen.clear();
        self.unsorted.clear();
        self.band_starts.clear();
        self.band_starts.resize(camera.height.div_ceil(TILE) + 1, 0);
        let eye = SimdCamera::<S, K>::new(simd, camera);
        let blocks = &prepared.blocks[ranks.start / MAX_LANES..ranks.end.div_ceil(MAX_LANES)];
        for (block, first) in blocks.iter().zip(ranks.step_by(MAX_LANES)) {
            for lane in (0..MAX_LANES).step_by(S::WIDTH) {
                let sight = eye.look_at(simd, block, lane);
                for i in set_bits(sight.seen) {
                    self.take_up(&sight, i, (first + lane + i) as u32, camera.width);
                }
            }
        }
        self.sort_spans();
    }

    /// Takes up the splat in a lane, if it has spans.
    #[inline(always)]
    fn take_up(&mut self, sight: &Projected<T>, lane: usize, rank: u32, width: usize) {
        let [left, right, top, bottom] = [0, 1, 2, 3].map(|k| sight.tiles[k][lane]);
        let footprint = sight.footprints[lane];
        let (splat, before) = (self.seen.len() as u32, self.unsorted.len());
        for band in top..=bottom {
            // Most splats are narrower than a tile: nothing is to be told apart.
            let tiles = if left == right {
                Some((left, right))
            } else {
                Footprint::of(footprint).tiles(sight.half_cols[lane], band, width)
            };
            if let Some((first, last)) = tiles {
                self.unsorted.push((band, Span { splat, first: first as u16, last: last as u16 }));
                self.band_starts[band as usize + 1] += 1;
            }
        }
        if self.unsorted.len() > before {
            self.seen.push(Seen { footprint, rank });
        }
    }

    /// A counting sort by band, once spans are counted; equal bands keep their order.
    fn sort_spans(&mut self) {
        // A band's start stands one place further until its spans have made it the band's end.
        let mut start = 0;
        for place in &mut self.band_starts[1..] {
            start += std::mem::replace(place, start);
        }
        self.spans.resize(self.unsorted.len(), Span { splat: 0, first: 0, last: 0 });
        self.drawn.resize(self.unsorted.len(), Seen::default());
        for (band, span) in &self.unsorted {
            let place = &mut self.band_starts[*band as usize + 1];
            self.spans[*place as usize] = *span;
            self.drawn[*place as usize] = self.seen[span.splat as usize];
            *place += 1;
        }
    }

    /// Spans in one band, by rank.
    pub fn spans(&self, band: usize) -> &[Span] {
        &self.spans[self.places(band)]
    }

    /// The splats of [`Chunk::spans`].
    pub fn drawn(&self, band: usize) -> &[Seen<T>] {
        &self.drawn[self.places(band)]
    }

    fn places(&self, band: usize) -> Range<usize> {
        self.band_starts[band] as usize..self.band_starts[band + 1] as usize
    }

    /// Sums the bands' slots per footprint and adds them, taken back through the camera, to the splats' gradients.
    pub fn gather<const C: usize, K: CameraKernel<T>>(
        &mut self,
        index: usize,
        bands: &[Band<T, C>],
        sorted: &SortedSplats<T>,
        camera: &K,
        gradients: &mut [SplatGradient<T>],
        by_feature: &mut [[T; C]],
    ) {
        // By splat: small enough to stay in the cache, while all else is read and written from first to last.
        let mut sums = [GradientSlot::default(); CHUNK];
        for (b, band) in bands.iter().enumerate() {
            for (span, slot) in self.spans(b).iter().zip(band.slots_of_chunk(index)) {
                sums[span.splat as usize].add(slot);
            }
        }
        self.by_mean.clear();
        self.by_mean.resize(gradients.len(), None);
        for (splat, sum) in self.seen.iter().zip(&sums) {
            let place = splat.rank as usize - self.start;
            let footprint = Footprint::of(splat.footprint);
            let shape = sorted.position_and_covariance(splat.rank as usize);
            self.by_mean[place] = Some(footprint.back_project(camera, shape, sum, &mut gradients[place]));
            add(&mut by_feature[place], sum.feature);
        }
    }

    /// The derivative by the image position of a splat, by its rank within the chunk; none if no pixel sees it.
    pub fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        self.by_mean[rank]
    }
}

impl<T: Real> Footprint<T> {
    /// Adds what the sums over the image mean for the splat; gives the derivative by the ellipse's centre.
    #[inline(always)]
    fn back_project<const C: usize, K: CameraKernel<T>>(
        &self,
        camera: &K,
        (position, covariance): ([T; 3], [T; 6]),
        by: &GradientSlot<T, C>,
        out: &mut SplatGradient<T>,
    ) -> [T; 2] {
        let m = camera.jacobian(position);
        let ([a, b, c], [sum, x, xx, y, xy, yy]) = (self.conic, by.moments);
        let mean = [a * x + b * y, b * x + c * y];
        out.log_opacity = out.log_opacity + sum;
        // By the image's covariance: half of conic * moments * conic.
        let half = T::from_f64(0.5);
        let p = [[a * xx + b * xy, a * xy + b * yy], [b * xx + c * xy, b * xy + c * yy]];
        let gxx = half * (p[0][0] * a + p[0][1] * b);
        let gxy = half * (p[0][0] * b + p[0][1] * c);
        let gyy = half * (p[1][0] * b + p[1][1] * c);
        for (k, (i, j)) in ELEMENTS.into_iter().enumerate() {
            let [u, v] = [gxx * m[0][j] + gxy * m[1][j], gxy * m[0][j] + gyy * m[1][j]];
            out.covariance[k] = out.covariance[k] + m[0][i] * u + m[1][i] * v;
        }
        // The image's covariance is J S Jᵀ: its derivative by J is 2 G J S.
        let mut by_jacobian = [[T::zero(); 3]; 2];
        if K::IS_CURVED {
            let [xx, xy, xz, yy, yz, zz] = covariance;
            let twice = |a: T, b: T| {
                let row: [T; 3] = std::array::from_fn(|k| a * m[0][k] + b * m[1][k]);
                let row = row.map(|v| v + v);
                let dot = |c: [T; 3]| row[0] * c[0] + row[1] * c[1] + row[2] * c[2];
                [dot([xx, xy, xz]), dot([xy, yy, yz]), dot([xz, yz, zz])]
            };
            by_jacobian = [twice(gxx, gxy), twice(gxy, gyy)];
        }
        camera.add_position_gradient(position, mean, by_jacobian, &mut out.position);
        mean
    }

    /// The first and the last tile that it touches in a band's rows, if any; `half_cols` is half its width.
    #[inline(always)]
    fn tiles(&self, half_cols: T, band: u32, width: usize) -> Option<(u32, u32)> {
        let [mx, my] = self.mean;
        let top = T::from_f64(f64::from(band) * TILE as f64) - my;
        let bottom = top + T::from_f64(TILE as f64 - 1.0);
        let left = mx + self.furthest(-T::one(), half_cols, top, bottom);
        let right = mx + self.furthest(T::one(), half_cols, top, bottom);
        let left = left.max(T::zero()).ceil();
        let right = right.min(T::from_f64(width as f64 - 1.0)).floor();
        (left <= right).then(|| (left.as_u32() / TILE as u32, right.as_u32() / TILE as u32))
    }

    /// Column (from the centre) of the ellipse's edge on one `side` (-1 or 1) within a band's rows.
    #[inline(always)]
    fn furthest(&self, side: T, half_cols: T, top: T, bottom: T) -> T {
        let lean = side * self.lean;
        if lean >= top && lean <= bottom {
            return side * half_cols;
        }
        let dy = lean.max(top).min(bottom);
        let [a, b, c] = self.conic;
        let inside = b * b * dy * dy - a * (c * dy * dy - self.radius2);
        // A band that the ellipse only grazes can miss it by rounding.
        (side * inside.max(T::zero()).sqrt() - b * dy) / a
    }
}

/// What a camera sees of a row of splats.
struct Projected<T> {
    /// The lanes of those with a pixel in their ellipse's box, as bits.
    seen: u32,
    /// [`Footprint::numbers`].
    footprints: [[T; 8]; MAX_LANES],
    /// Half widths of the ellipses, pixels.
    half_cols: [T; MAX_LANES],
    /// First and last column of tiles that an ellipse's box touches, first and last row.
    tiles: [[u32; MAX_LANES]; 4],
}

/// A camera, each of its numbers in every lane.
struct SimdCamera<S: Simd, K: CameraKernel<S::Scalar>> {
    kernel: K::Broadcast<S>,
    /// Columns and rows of its image.
    size: [SimdVec<S>; 2],
}

impl<S: Simd, K: CameraKernel<S::Scalar>> SimdCamera<S, K> {
    #[inline(always)]
    fn new(simd: S, camera: &FrameCamera<K>) -> Self {
        let size = [camera.width as f64, camera.height as f64].map(S::Scalar::from_f64);
        Self { kernel: camera.kernel.broadcast(simd), size: broadcast_each(simd, size) }
    }

    /// The ellipses of splats, and their half widths and heights.
    #[inline(always)]
    fn project(
        &self,
        simd: S,
        position: [SimdVec<S>; 3],
        covariance: [SimdVec<S>; 6],
        opacity: SimdVec<S>,
    ) -> (Footprint<SimdVec<S>>, [SimdVec<S>; 2]) {
        let constants = [-ALPHA_CUT.log2(), 2.0 * std::f64::consts::LN_2, LOW_PASS_PX2, 0.0];
        let [above_cut, twice_ln_2, low_pass, zero] =
            broadcast_each(simd, constants.map(S::Scalar::from_f64));
        let [sxx, sxy, sxz, syy, syz, szz] = covariance;
        let Linearized { mean, jacobian: m } = K::linearize(simd, &self.kernel, position);
        let mut rows = [[zero; 3]; 2];
        for i in 0..2 {
            let [a, b, c] = m[i];
            rows[i] = [a * sxx + b * sxy + c * sxz, a * sxy + b * syy + c * syz, a * sxz + b * syz + c * szz];
        }
        let [r, s] = rows;
        let xx = r[0] * m[0][0] + r[1] * m[0][1] + r[2] * m[0][2] + low_pass;
        let xy = r[0] * m[1][0] + r[1] * m[1][1] + r[2] * m[1][2];
        let yy = s[0] * m[1][0] + s[1] * m[1][1] + s[2] * m[1][2] + low_pass;
        let inverse = (xx * yy - xy * xy).reciprocal();
        let log2_opacity = opacity.log2();
        let radius2 = twice_ln_2 * (log2_opacity + above_cut);
        let half_size = [(radius2 * xx).sqrt(), (radius2 * yy).sqrt()];
        // The regression line of row on column.
        let lean = xy * xx.reciprocal() * half_size[0];
        let conic = [yy * inverse, zero - xy * inverse, xx * inverse];
        (Footprint { mean, conic, log2_opacity, radius2, lean }, half_size)
    }

    /// What it sees of the splats of a block from a lane on.
    #[inline(always)]
    fn look_at(&self, simd: S, block: &SplatBlock<S::Scalar>, lane: usize) -> Projected<S::Scalar> {
        let constants = [0.0, 1.0, 1.0 / TILE as f64, ALPHA_CUT, f32::MAX.into()];
        let [zero, one, sixteenth, cut, most] = broadcast_each(simd, constants.map(S::Scalar::from_f64));
        let (mut position, mut covariance) = ([zero; 3], [zero; 6]);
        for k in 0..3 {
            position[k] = SimdVec::load(simd, &block.position[k][lane..]);
        }
        for k in 0..6 {
            covariance[k] = SimdVec::load(simd, &block.covariance[k][lane..]);
        }
        let opacity = SimdVec::load(simd, &block.opacity[lane..]);
        let (footprint, half_size) = self.project(simd, position, covariance, opacity);
        let Footprint { mean, conic, radius2, .. } = footprint;
        let mut seen = opacity.greater_than(cut);
        if let Some(in_front) = K::in_front(simd, &self.kernel, position) {
            seen = seen.and(in_front);
        }
        for positive in [radius2, conic[0], conic[2]] {
            seen = seen.and(positive.greater_than(zero)).and(most.greater_equal(positive));
        }
        let mut sight = Projected {
            seen: 0,
            footprints: arrays_of_lanes(footprint.numbers()),
            half_cols: [S::Scalar::from_f64(0.0); MAX_LANES],
            tiles: [[0; MAX_LANES]; 4],
        };
        for i in 0..2 {
            let (low, high) = (mean[i] - half_size[i], mean[i] + half_size[i]);
            // The first pixel from `low` and the last up to `high`, as far as there are any.
            let low = low.max(zero).min(self.size[i]);
            let whole = low.floor();
            let first = whole + one.select_or_zero(low.greater_than(whole));
            let last = high.min(self.size[i] - one).max(zero).floor();
            seen = seen
                .and(most.greater_equal(mean[i].abs()))
                .and(high.greater_equal(zero))
                .and(last.greater_equal(first));
            (first * sixteenth).floor().store_u32(&mut sight.tiles[2 * i]);
            (last * sixteenth).floor().store_u32(&mut sight.tiles[2 * i + 1]);
        }
        sight.seen = seen.bitmask();
        half_size[0].store_to(&mut sight.half_cols, 0);
        sight
    }
}
