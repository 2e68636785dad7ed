//! Projection of the splats by one camera (EWA splatting; 3DGS, equation 5): image ellipses, the slopes of the planes of
//! discs, and the spans of tiles that they touch in each band of the image.

use super::block::TILE;
use super::constants::{ALPHA_CUT, LOW_PASS_PX2};
use super::footprint::Footprint;
use super::primitive::{Primitive, StoredNumbers};
use super::slope::{slope_damping, slope_in_front};
use super::sorted::SortedSplats;
use super::splat_block::SplatBlock;
use crate::camera::{CameraKernel, DepthOrder, Linearized};
use crate::simd::Real;
use crate::simd::{
    MAX_LANES, Simd, SimdKernel, SimdReal, SimdVec, arrays_of_lanes, broadcast_each, set_bits,
};
use std::ops::Range;

/// Number of ranks that one task projects; fixed, so that sums do not depend on the number of threads.
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

/// A splat whose ellipse touches the image.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct VisibleSplat<T: Real, P: Primitive> {
    /// [`Footprint::numbers`].
    pub footprint: [T; 8],
    /// Slope of its plane.
    pub slope: P::Slope<T>,
    /// Rank of the splat.
    pub rank: u32,
}

/// The tile columns `first..=last` of one band that the ellipse of a chunk's splat touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// Index of the splat in its chunk's list of visible splats.
    pub splat: u32,
    /// First tile column.
    pub first: u16,
    /// Last tile column.
    pub last: u16,
}

/// The projection of a run of successive ranks: the visible splats and their spans.
pub(super) struct Chunk<T: Real, P: Primitive> {
    /// First rank.
    pub(super) start: usize,
    /// Splats whose ellipses touch the image, by rank.
    pub(super) visible: Vec<VisibleSplat<T, P>>,
    /// Spans sorted by band, and within a band by rank.
    spans: Vec<Span>,
    /// A copy of the splat of each span, so that a band reads memory in order.
    span_splats: Vec<VisibleSplat<T, P>>,
    /// Spans of band `b` are `spans[band_starts[b]..band_starts[b + 1]]`.
    band_starts: Vec<u32>,
    /// Band and span, by rank.
    unsorted: Vec<(u32, Span)>,
    /// Derivative with respect to the 2-D mean of each rank's splat, per pixel; none for splats that are not visible.
    pub(super) mean2d_gradients: Vec<Option<[T; 2]>>,
    /// Derivatives with respect to the normals of discs, by rank; zero for discs that are not visible.
    pub(super) normal_gradients: Vec<[T; 3]>,
}

/// The kernel that projects a chunk, compiled for each instruction set.
pub(super) struct Projection<'a, T: Real, K, P: Primitive> {
    pub chunk: &'a mut Chunk<T, P>,
    pub sorted: &'a SortedSplats<T>,
    pub ranks: Range<usize>,
    pub camera: &'a FrameCamera<K>,
}

impl<T: SimdReal, K: CameraKernel<T>, P: Primitive> SimdKernel<T> for Projection<'_, T, K, P> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        self.chunk.project(simd, self.sorted, self.ranks, self.camera);
    }
}

impl<T: Real, P: Primitive> Default for Chunk<T, P> {
    fn default() -> Self {
        Self {
            start: 0,
            visible: Vec::new(),
            spans: Vec::new(),
            span_splats: Vec::new(),
            band_starts: Vec::new(),
            unsorted: Vec::new(),
            mean2d_gradients: Vec::new(),
            normal_gradients: Vec::new(),
        }
    }
}

impl<T: Real, P: Primitive> Chunk<T, P> {
    /// Projects the splats of `ranks` and lists those whose ellipses touch a pixel.
    #[inline(always)]
    fn project<S: Simd<Scalar = T>, K: CameraKernel<T>>(
        &mut self,
        simd: S,
        sorted: &SortedSplats<T>,
        ranks: Range<usize>,
        camera: &FrameCamera<K>,
    ) {
        self.start = ranks.start;
        self.visible.clear();
        self.unsorted.clear();
        self.band_starts.clear();
        self.band_starts.resize(camera.height.div_ceil(TILE) + 1, 0);
        let simd_camera = SimdCamera::<S, K>::new(simd, camera);
        let blocks = ranks.start / MAX_LANES..ranks.end.div_ceil(MAX_LANES);
        for (b, first) in blocks.zip(ranks.step_by(MAX_LANES)) {
            let (block, normals) = (&sorted.blocks[b], P::IS_FLAT.then(|| &sorted.normals[b]));
            for lane in (0..MAX_LANES).step_by(S::WIDTH) {
                let projected = simd_camera.project_block(simd, block, normals, lane);
                for i in set_bits(projected.visible) {
                    self.push_spans(&projected, i, (first + lane + i) as u32, camera.width);
                }
            }
        }
        self.sort_spans();
    }

    /// Adds the spans of the splat in a lane, and the splat if it has any.
    #[inline(always)]
    fn push_spans(&mut self, projected: &Projected<T>, lane: usize, rank: u32, width: usize) {
        let [left, right, top, bottom] = [0, 1, 2, 3].map(|k| projected.tiles[k][lane]);
        let footprint = projected.footprints[lane];
        let silhouette = projected.silhouettes.as_ref().map_or(footprint, |numbers| numbers[lane]);
        let (splat, before) = (self.visible.len() as u32, self.unsorted.len());
        for band in top..=bottom {
            // Most ellipses lie within one column of tiles, where the exact edges do not matter.
            let tiles = if left == right {
                Some((left, right))
            } else {
                Footprint::of(silhouette).tiles(projected.half_width[lane], band, width)
            };
            if let Some((first, last)) = tiles {
                self.unsorted.push((band, Span { splat, first: first as u16, last: last as u16 }));
                self.band_starts[band as usize + 1] += 1;
            }
        }
        if self.unsorted.len() > before {
            let slope = P::Slope::of(projected.slopes[lane]);
            self.visible.push(VisibleSplat { footprint, slope, rank });
        }
    }

    /// Sorts the spans by band with a stable counting sort; `band_starts[b + 1]` holds the number of spans of band `b`.
    fn sort_spans(&mut self) {
        // The next free place of band `b` stands in `band_starts[b + 1]`; it ends as the start of band `b + 1`.
        let mut start = 0;
        for count in &mut self.band_starts[1..] {
            start += std::mem::replace(count, start);
        }
        self.spans.resize(self.unsorted.len(), Span { splat: 0, first: 0, last: 0 });
        self.span_splats.resize(self.unsorted.len(), VisibleSplat::default());
        for (band, span) in &self.unsorted {
            let next = &mut self.band_starts[*band as usize + 1];
            self.spans[*next as usize] = *span;
            self.span_splats[*next as usize] = self.visible[span.splat as usize];
            *next += 1;
        }
    }

    /// The spans of one band, by rank.
    pub fn spans(&self, band: usize) -> &[Span] {
        &self.spans[self.band_range(band)]
    }

    /// The splat of each of [`Chunk::spans`].
    pub fn splats(&self, band: usize) -> &[VisibleSplat<T, P>] {
        &self.span_splats[self.band_range(band)]
    }

    /// The spans of one band, as a range of `spans`.
    fn band_range(&self, band: usize) -> Range<usize> {
        self.band_starts[band] as usize..self.band_starts[band + 1] as usize
    }

    /// Derivative with respect to the 2-D mean of a splat, per pixel, by its rank within the chunk; none if it is not
    /// visible.
    pub fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        self.mean2d_gradients[rank]
    }
}

/// The projections of as many splats as a vector has lanes.
struct Projected<T> {
    /// Bit mask of the lanes whose ellipse's bounding box holds a pixel.
    visible: u32,
    /// [`Footprint::numbers`].
    footprints: [[T; 8]; MAX_LANES],
    /// [`Footprint::numbers`] of the ellipses on which alpha equals the cut-off, if they are others: those of discs in a
    /// perspective projection.
    silhouettes: Option<[[T; 8]; MAX_LANES]>,
    /// Slopes of the planes; zero for ellipsoids.
    slopes: [[T; 2]; MAX_LANES],
    /// Half of the ellipses' widths, pixels.
    half_width: [T; MAX_LANES],
    /// First and last column of tiles that an ellipse's bounding box touches, then first and last row of tiles.
    tiles: [[u32; MAX_LANES]; 4],
}

/// The images of the splats in the lanes.
struct Footprints<S: Simd> {
    footprint: Footprint<SimdVec<S>>,
    /// Half of their widths and heights, pixels.
    half_size: [SimdVec<S>; 2],
    /// Their covariances (xx, xy, yy), px².
    covariance: [SimdVec<S>; 3],
}

/// A camera whose numbers are broadcast to all lanes.
struct SimdCamera<S: Simd, K: CameraKernel<S::Scalar>> {
    kernel: K::Broadcast<S>,
    /// Columns and rows of the image.
    size: [SimdVec<S>; 2],
}

impl<S: Simd, K: CameraKernel<S::Scalar>> SimdCamera<S, K> {
    #[inline(always)]
    fn new(simd: S, camera: &FrameCamera<K>) -> Self {
        let size = [camera.width as f64, camera.height as f64].map(S::Scalar::from_f64);
        Self { kernel: camera.kernel.broadcast(simd), size: broadcast_each(simd, size) }
    }

    /// The footprints of the splats in the lanes.
    #[inline(always)]
    fn footprints(
        &self,
        simd: S,
        position: [SimdVec<S>; 3],
        covariance: [SimdVec<S>; 6],
        opacity: SimdVec<S>,
    ) -> Footprints<S> {
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
        // The rightmost point lies on the regression line of row on column.
        let rightmost_dy = xy * xx.reciprocal() * half_size[0];
        let conic = [yy * inverse, zero - xy * inverse, xx * inverse];
        let footprint = Footprint { mean, conic, log2_opacity, radius2, rightmost_dy };
        Footprints { footprint, half_size, covariance: [xx, xy, yy] }
    }

    /// The slopes of discs with these normals and images; zero where the plane meets the camera's plane close by.
    #[inline(always)]
    fn slopes(
        &self,
        simd: S,
        position: [SimdVec<S>; 3],
        normal: [SimdVec<S>; 3],
        covariance: [SimdVec<S>; 3],
        radius2: SimdVec<S>,
    ) -> [SimdVec<S>; 2] {
        let low_pass = SimdVec::broadcast(simd, S::Scalar::from_f64(LOW_PASS_PX2));
        let [xx, xy, yy] = covariance;
        let damping = slope_damping(simd, [xx - low_pass, xy, yy - low_pass]);
        let [x, y] = K::plane_slope(simd, &self.kernel, position, normal);
        let slope = [x * damping, y * damping];
        match K::ORDER {
            DepthOrder::Altitude => slope,
            DepthOrder::Camera => slope_in_front(simd, slope, covariance, radius2),
        }
    }

    /// Projects the splats of a block from a lane on.
    #[inline(always)]
    fn project_block(
        &self,
        simd: S,
        block: &SplatBlock<S::Scalar>,
        normals: Option<&[[S::Scalar; MAX_LANES]; 3]>,
        lane: usize,
    ) -> Projected<S::Scalar> {
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
        let Footprints { footprint, mut half_size, covariance } =
            self.footprints(simd, position, covariance, opacity);
        let Footprint { conic, radius2, .. } = footprint;
        let (mut slope, mut silhouette) = ([zero; 2], footprint);
        if let Some(normals) = normals {
            let mut normal = [zero; 3];
            for k in 0..3 {
                normal[k] = SimdVec::load(simd, &normals[k][lane..]);
            }
            slope = self.slopes(simd, position, normal, covariance, radius2);
            if matches!(K::ORDER, DepthOrder::Camera) {
                (silhouette, half_size) = footprint.silhouette(simd, slope, covariance);
            }
        }
        let mean = silhouette.mean;
        let mut visible = opacity.greater_than(cut);
        if let Some(in_front) = K::in_front(simd, &self.kernel, position) {
            visible = visible.and(in_front);
        }
        for positive in [radius2, conic[0], conic[2]] {
            visible = visible.and(positive.greater_than(zero)).and(most.greater_equal(positive));
        }
        let mut projected = Projected {
            visible: 0,
            footprints: arrays_of_lanes(footprint.numbers()),
            silhouettes: None,
            slopes: [[S::Scalar::from_f64(0.0); 2]; MAX_LANES],
            half_width: [S::Scalar::from_f64(0.0); MAX_LANES],
            tiles: [[0; MAX_LANES]; 4],
        };
        if normals.is_some() && matches!(K::ORDER, DepthOrder::Camera) {
            projected.silhouettes = Some(arrays_of_lanes(silhouette.numbers()));
        }
        for i in 0..2 {
            let (low, high) = (mean[i] - half_size[i], mean[i] + half_size[i]);
            // The first pixel at or after `low` and the last at or before `high`, within the image.
            let low = low.max(zero).min(self.size[i]);
            let whole = low.floor();
            let first = whole + one.select_or_zero(low.greater_than(whole));
            let last = high.min(self.size[i] - one).max(zero).floor();
            visible = visible
                .and(most.greater_equal(mean[i].abs()))
                .and(high.greater_equal(zero))
                .and(last.greater_equal(first));
            (first * sixteenth).floor().store_u32(&mut projected.tiles[2 * i]);
            (last * sixteenth).floor().store_u32(&mut projected.tiles[2 * i + 1]);
        }
        projected.visible = visible.bitmask();
        half_size[0].store_to(&mut projected.half_width, 0);
        let mut slopes = [[S::Scalar::from_f64(0.0); MAX_LANES]; 2];
        for k in 0..2 {
            slope[k].store_to(&mut slopes[k], 0);
            for i in 0..MAX_LANES {
                projected.slopes[i][k] = slopes[k][i];
            }
        }
        projected
    }
}
