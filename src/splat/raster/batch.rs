//! A batch of a tile's splats, prepared for compositing: the polynomial of each splat's alpha over the tile, and the list of
//! splats that touch each block of pixels.
//!
//! Each block is composited on its own, so that the state of its pixels stays in registers from the first splat to the last.
//! The lists are computed for as many splats at once as a vector has lanes: each lane finds the columns of its splat's
//! ellipse within the rows of a block.

use super::bands::TileEntry;
use super::block::{
    BLOCK_WIDTH, BLOCKS_ACROSS, BlockPixels, MAX_BLOCKS, TILE, block_height, blocks_down, offset, tile_center,
};
use super::channel;
use super::footprint::Footprint;
use super::primitive::{Primitive, StoredNumbers};
use crate::camera::{CameraKernel, DepthOrder};
use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdMask, SimdVec, broadcast_each, transpose_eights};
use std::marker::PhantomData;

/// Number of indices that a byte can hold: splats of a batch have byte indices.
pub(super) const CAPACITY: usize = 256;
/// Largest number of splats in a batch; also the index of a padding splat that touches no pixel.
pub(super) const BATCH: usize = CAPACITY - 1;
/// Number of splats that the backward pass processes together.
pub(super) const GROUP: usize = 4;
/// Added to an ellipse's squared Mahalanobis radius, so that rounding and approximate square roots lose no block.
const RADIUS2_TOLERANCE: f64 = 0.02;

/// Up to [`BATCH`] splats of a tile, nearest first.
pub(super) struct Batch<T, const C: usize, K, P> {
    /// Coefficients 1, x, y, xx, xy, yy of the base-2 logarithm of alpha, a polynomial in the offset from the tile's
    /// centre, pixels. For discs in a perspective projection, those of the same without the opacity and times the square of
    /// the plane's denominator.
    log2_alpha: [[T; CAPACITY]; 6],
    /// Of discs in a perspective projection: base-2 logarithms of the opacities.
    log2_opacity: [T; CAPACITY],
    /// Of discs: coefficients 1, x, y of the plane, which is the altitude or the denominator of the depth, and the mapped
    /// depth of the centre (see [`Batch::mapped_depth`]).
    plane: [[T; CAPACITY]; 4],
    /// Offsets of the splats' centres from the tile's centre, pixels.
    center: [[T; CAPACITY]; 2],
    features: [[T; C]; CAPACITY],
    /// Indices of the splats that touch each block, nearest first, followed by padding splats; with room for what
    /// [`SimdMask::compress`] writes beyond them.
    lists: [[u8; CAPACITY + MAX_LANES]; MAX_BLOCKS],
    /// Number of splats in each list, without padding.
    lengths: [usize; MAX_BLOCKS],
    kinds: PhantomData<(K, P)>,
}

impl<T: Real, const C: usize, K: CameraKernel<T>, P: Primitive> Batch<T, C, K, P> {
    /// Whether the splats are discs in a perspective projection.
    pub const IS_PERSPECTIVE_DISC: bool = P::IS_FLAT && matches!(K::ORDER, DepthOrder::Camera);
    /// Index of the feature that is the depth.
    pub const DEPTH: usize = if C == 1 { 0 } else { channel::DEPTH };

    #[inline(always)]
    pub fn new() -> Self {
        Self {
            log2_alpha: [[T::zero(); CAPACITY]; 6],
            log2_opacity: [T::zero(); CAPACITY],
            plane: [[T::zero(); CAPACITY]; 4],
            center: [[T::zero(); CAPACITY]; 2],
            features: [[T::zero(); C]; CAPACITY],
            lists: [[0; CAPACITY + MAX_LANES]; MAX_BLOCKS],
            lengths: [0; MAX_BLOCKS],
            kinds: PhantomData,
        }
    }

    /// Fills the batch with up to [`BATCH`] splats of a tile.
    #[inline(always)]
    pub fn fill<S: Simd<Scalar = T>>(
        &mut self,
        simd: S,
        edges: &BlockEdges<S>,
        entries: &[TileEntry<T, C, P>],
        tile: usize,
        band: usize,
    ) {
        self.lengths = [0; MAX_BLOCKS];
        let tile_center = broadcast_each(simd, [tile_center(tile), tile_center(band)]);
        for (k, entries) in entries.chunks(S::WIDTH).enumerate() {
            let first = k * S::WIDTH;
            for (i, entry) in entries.iter().enumerate() {
                self.features[first + i] = entry.feature;
            }
            let mut f = footprints(simd, entries);
            f.mean = [f.mean[0] - tile_center[0], f.mean[1] - tile_center[1]];
            let log2_opacity = f.log2_opacity;
            if Self::IS_PERSPECTIVE_DISC {
                f.log2_opacity = SimdVec::broadcast(simd, T::zero());
            }
            let log2_alpha = f.log2_alpha(simd);
            if P::IS_FLAT {
                self.fill_planes(simd, f.mean, entries, first);
            }
            for k in 0..6 {
                log2_alpha[k].store_to(&mut self.log2_alpha[k], first);
            }
            for k in 0..2 {
                f.mean[k].store_to(&mut self.center[k], first);
            }
            if Self::IS_PERSPECTIVE_DISC {
                log2_opacity.store_to(&mut self.log2_opacity, first);
                f = outline(simd, f, slopes(simd, entries));
            }
            let ellipses = Ellipses::new(simd, &f);
            let real = SimdMask::first(simd, entries.len());
            for down in 0..blocks_down::<S>() {
                let [left, right] = ellipses.column_range(edges, down);
                for across in 0..BLOCKS_ACROSS {
                    let [first_column, last_column] = edges.columns[across];
                    let touched =
                        right.greater_equal(first_column).and(last_column.greater_equal(left)).and(real);
                    let block = down * BLOCKS_ACROSS + across;
                    let after = &mut self.lists[block][self.lengths[block]..];
                    self.lengths[block] += touched.compress(first as u8, after);
                }
            }
        }
        for coefficient in &mut self.log2_alpha {
            coefficient[BATCH] = T::zero();
        }
        self.log2_alpha[0][BATCH] = T::from_f64(LOG2_ALPHA_OF_PADDING);
        self.features[BATCH] = [T::zero(); C];
        if P::IS_FLAT {
            self.log2_opacity[BATCH] = T::zero();
            for k in 0..4 {
                self.plane[k][BATCH] = if k == 0 { T::one() } else { T::zero() };
            }
        }
        for (list, length) in self.lists.iter_mut().zip(self.lengths) {
            list[length..length + GROUP].fill(BATCH as u8);
        }
    }

    /// Computes the planes of a row of discs whose projected centres are given relative to the tile's centre.
    #[inline(always)]
    fn fill_planes<S: Simd<Scalar = T>>(
        &mut self,
        simd: S,
        mean: [SimdVec<S>; 2],
        entries: &[TileEntry<T, C, P>],
        first: usize,
    ) {
        let slope = slopes(simd, entries);
        let mut depths = [T::one(); MAX_LANES];
        for (depth, entry) in depths.iter_mut().zip(entries) {
            *depth = entry.feature.get(Self::DEPTH).copied().unwrap_or(T::one());
        }
        let depth = SimdVec::load(simd, &depths);
        let one = SimdVec::broadcast(simd, T::one());
        let (constant, mapped) =
            if Self::IS_PERSPECTIVE_DISC { (one, depth.reciprocal()) } else { (depth, depth) };
        (constant - slope[0] * mean[0] - slope[1] * mean[1]).store_to(&mut self.plane[0], first);
        slope[0].store_to(&mut self.plane[1], first);
        slope[1].store_to(&mut self.plane[2], first);
        mapped.store_to(&mut self.plane[3], first);
    }

    /// The plane of a disc at the pixels of a block: its altitude, or the denominator of its depth.
    #[inline(always)]
    pub fn plane_at<S: Simd<Scalar = T>>(&self, simd: S, splat: u8, at: &BlockPixels<S>) -> SimdVec<S> {
        let coefficient = |k: usize| SimdVec::broadcast(simd, self.plane[k][usize::from(splat)]);
        coefficient(2).mul_add(at.y, coefficient(1).mul_add(at.x, coefficient(0)))
    }

    /// The mapped depth of a disc's centre: its altitude in a parallel projection, the reciprocal of its depth in a perspective
    /// one.
    #[inline(always)]
    pub fn mapped_depth(&self, splat: u8) -> T {
        self.plane[3][usize::from(splat)]
    }

    /// Depth of a disc's centre.
    #[inline(always)]
    pub fn depth(&self, splat: u8) -> T {
        self.features[usize::from(splat)].get(Self::DEPTH).copied().unwrap_or(T::one())
    }

    /// Base-2 logarithm of the opacity of a disc in a perspective projection.
    #[inline(always)]
    pub fn log2_opacity(&self, splat: u8) -> T {
        self.log2_opacity[usize::from(splat)]
    }

    /// Indices of the splats that touch a block, nearest first.
    #[inline(always)]
    pub fn list(&self, block: usize) -> &[u8] {
        &self.lists[block][..self.lengths[block]]
    }

    /// As [`Batch::list`], padded to a multiple of [`GROUP`] with splats that touch no pixel.
    #[inline(always)]
    pub fn padded_list(&self, block: usize) -> &[u8] {
        &self.lists[block][..self.lengths[block].next_multiple_of(GROUP)]
    }

    /// Base-2 logarithm of a splat's alpha at the pixels of a block.
    #[inline(always)]
    pub fn log2_alpha_at<S: Simd<Scalar = T>>(&self, simd: S, splat: u8, at: &BlockPixels<S>) -> SimdVec<S> {
        let coefficient = |k: usize| SimdVec::broadcast(simd, self.log2_alpha[k][usize::from(splat)]);
        // Two independent sums, which the processor computes in parallel.
        let by_x = coefficient(3).mul_add(at.xx, coefficient(1).mul_add(at.x, coefficient(0)));
        let by_y = coefficient(5).mul_add(at.yy, coefficient(2) * at.y);
        coefficient(4).mul_add(at.xy, by_x) + by_y
    }

    /// Offsets from the tile's centre of the centres of a row of splats.
    #[inline(always)]
    pub fn centers<S: Simd<Scalar = T>>(&self, simd: S, first: usize) -> [SimdVec<S>; 2] {
        [SimdVec::load(simd, &self.center[0][first..]), SimdVec::load(simd, &self.center[1][first..])]
    }

    /// Offset from the tile's centre of the centre of a splat.
    #[inline(always)]
    pub fn center(&self, splat: usize) -> [T; 2] {
        [self.center[0][splat], self.center[1][splat]]
    }

    /// Features of a splat.
    #[inline(always)]
    pub fn features(&self, splat: u8) -> [T; C] {
        self.features[usize::from(splat)]
    }
}

/// Base-2 logarithm of a padding splat's alpha, far below that of [`ALPHA_CUT`](super::ALPHA_CUT).
const LOG2_ALPHA_OF_PADDING: f64 = -100.0;

/// The ellipses of up to [`Simd::WIDTH`] splats, one in each lane; the last is repeated where there are fewer.
#[inline(always)]
fn footprints<S: Simd, const C: usize, P: Primitive>(
    simd: S,
    entries: &[TileEntry<S::Scalar, C, P>],
) -> Footprint<SimdVec<S>> {
    let mut rows = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); 8];
    for j in 0..8 {
        let last = entries.len() - 1;
        let (low, block_height) = (&entries[j.min(last)].footprint, &entries[(j + 8).min(last)].footprint);
        rows[j] = SimdVec::load_eights(simd, [low, block_height]);
    }
    Footprint::of(transpose_eights(rows))
}

/// The slopes of up to [`Simd::WIDTH`] discs, one in each lane.
#[inline(always)]
fn slopes<S: Simd, const C: usize, P: Primitive>(
    simd: S,
    entries: &[TileEntry<S::Scalar, C, P>],
) -> [SimdVec<S>; 2] {
    let mut slopes = [[S::Scalar::from_f64(0.0); MAX_LANES]; 2];
    for (i, entry) in entries.iter().enumerate() {
        let slope = entry.slope.get();
        for k in 0..2 {
            slopes[k][i] = slope[k];
        }
    }
    [SimdVec::load(simd, &slopes[0]), SimdVec::load(simd, &slopes[1])]
}

/// The ellipses on which the alphas of discs in a perspective projection equal the cut-off.
#[inline(always)]
fn outline<S: Simd>(simd: S, f: Footprint<SimdVec<S>>, slope: [SimdVec<S>; 2]) -> Footprint<SimdVec<S>> {
    let ([a, b, c], zero) = (f.conic, SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)));
    let inverse = (a * c - b * b).reciprocal();
    let covariance = [c * inverse, (zero - b) * inverse, a * inverse];
    f.silhouette(simd, slope, covariance).0
}

/// What ellipses are compared with: the edges of a tile's blocks, from the tile's centre, pixels.
pub(super) struct BlockEdges<S: Simd> {
    /// First and last row of each row of blocks.
    rows: [[SimdVec<S>; 2]; MAX_BLOCKS / BLOCKS_ACROSS],
    /// First and last column of each column of blocks.
    columns: [[SimdVec<S>; 2]; BLOCKS_ACROSS],
}

impl<S: Simd> BlockEdges<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let ends =
            |first: usize, count: usize| broadcast_each(simd, [offset(first), offset(first + count - 1)]);
        let mut rows = [ends(0, TILE); MAX_BLOCKS / BLOCKS_ACROSS];
        for down in 0..blocks_down::<S>() {
            rows[down] = ends(down * block_height::<S>(), block_height::<S>());
        }
        let mut columns = [rows[0]; BLOCKS_ACROSS];
        for across in 0..BLOCKS_ACROSS {
            columns[across] = ends(across * BLOCK_WIDTH, BLOCK_WIDTH);
        }
        Self { rows, columns }
    }
}

impl<S: Simd> Footprint<SimdVec<S>> {
    /// Coefficients 1, x, y, xx, xy, yy of the base-2 logarithm of alpha, a polynomial in the offset from the origin that
    /// `mean` is relative to.
    #[inline(always)]
    fn log2_alpha(&self, simd: S) -> [SimdVec<S>; 6] {
        let [minus_half, minus_two] =
            broadcast_each(simd, [-0.5 * std::f64::consts::LOG2_E, -2.0].map(S::Scalar::from_f64));
        let [u, v] = self.mean;
        let [a, b, c] = self.conic;
        let (xx, half_xy, yy) = (a * minus_half, b * minus_half, c * minus_half);
        let (x, y) = (xx * u + half_xy * v, half_xy * u + yy * v);
        let constant = self.log2_opacity + x * u + y * v;
        [constant, minus_two * x, minus_two * y, xx, half_xy + half_xy, yy]
    }
}

/// Ellipses, one in each lane, with centres relative to the tile's centre.
struct Ellipses<S: Simd> {
    mean: [SimdVec<S>; 2],
    /// Change from row to row of the column midway between the left and the right edge.
    slope: SimdVec<S>,
    /// Square of half the width on the row of the centre.
    half_width2: SimdVec<S>,
    /// Decrease of that square per squared distance from the row of the centre.
    half_width2_decrease: SimdVec<S>,
    /// Rows of the rightmost and of the leftmost point, relative to the centre.
    extreme_dy: [SimdVec<S>; 2],
}

impl<S: Simd> Ellipses<S> {
    #[inline(always)]
    fn new(simd: S, f: &Footprint<SimdVec<S>>) -> Self {
        let [tolerance, zero] = broadcast_each(simd, [RADIUS2_TOLERANCE, 0.0].map(S::Scalar::from_f64));
        let [a, b, c] = f.conic;
        let by_a = a.reciprocal();
        Self {
            mean: f.mean,
            slope: (zero - b) * by_a,
            half_width2: (f.radius2 + tolerance) * by_a,
            half_width2_decrease: (a * c - b * b) * by_a * by_a,
            extreme_dy: [f.rightmost_dy, zero - f.rightmost_dy],
        }
    }

    /// Leftmost and rightmost columns of the ellipses within a row of blocks; NaN where an ellipse does not reach it.
    ///
    /// The outermost point within the rows is the ellipse's own outermost point, or lies on the row nearest to it.
    #[inline(always)]
    fn column_range(&self, edges: &BlockEdges<S>, down: usize) -> [SimdVec<S>; 2] {
        let [u, v] = self.mean;
        let [top, bottom] = [edges.rows[down][0] - v, edges.rows[down][1] - v];
        let [right, left] =
            [self.extreme_dy[0].max(top).min(bottom), self.extreme_dy[1].max(top).min(bottom)];
        [
            self.slope.mul_add(left, u) - self.half_width(left),
            self.slope.mul_add(right, u) + self.half_width(right),
        ]
    }

    /// Half of the width on a row relative to the centre; NaN beyond the ellipse.
    #[inline(always)]
    fn half_width(&self, row: SimdVec<S>) -> SimdVec<S> {
        (self.half_width2 - self.half_width2_decrease * row * row).sqrt_approx()
    }
}
