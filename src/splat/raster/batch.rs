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
use super::footprint::Footprint;
use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdMask, SimdVec, broadcast_each, transpose_eights};

/// Number of indices that a byte can hold: splats of a batch have byte indices.
pub(super) const CAPACITY: usize = 256;
/// Largest number of splats in a batch; also the index of a padding splat that touches no pixel.
pub(super) const BATCH: usize = CAPACITY - 1;
/// Number of splats that the backward pass processes together.
pub(super) const GROUP: usize = 4;
/// Added to an ellipse's squared Mahalanobis radius, so that rounding and approximate square roots lose no block.
const RADIUS2_TOLERANCE: f64 = 0.02;

/// Up to [`BATCH`] splats of a tile, nearest first.
pub(super) struct Batch<T, const C: usize> {
    /// Coefficients 1, x, y, xx, xy, yy of the base-2 logarithm of alpha, a polynomial in the offset from the tile's
    /// centre, pixels.
    log2_alpha: [[T; CAPACITY]; 6],
    /// Offsets of the splats' centres from the tile's centre, pixels.
    center: [[T; CAPACITY]; 2],
    features: [[T; C]; CAPACITY],
    /// Indices of the splats that touch each block, nearest first, followed by padding splats; with room for what
    /// [`SimdMask::compress`] writes beyond them.
    lists: [[u8; CAPACITY + MAX_LANES]; MAX_BLOCKS],
    /// Number of splats in each list, without padding.
    lengths: [usize; MAX_BLOCKS],
}

impl<T: Real, const C: usize> Batch<T, C> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            log2_alpha: [[T::zero(); CAPACITY]; 6],
            center: [[T::zero(); CAPACITY]; 2],
            features: [[T::zero(); C]; CAPACITY],
            lists: [[0; CAPACITY + MAX_LANES]; MAX_BLOCKS],
            lengths: [0; MAX_BLOCKS],
        }
    }

    /// Fills the batch with up to [`BATCH`] splats of a tile.
    #[inline(always)]
    pub fn fill<S: Simd<Scalar = T>>(
        &mut self,
        simd: S,
        edges: &BlockEdges<S>,
        entries: &[TileEntry<T, C>],
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
            let log2_alpha = f.log2_alpha(simd);
            for k in 0..6 {
                log2_alpha[k].store_to(&mut self.log2_alpha[k], first);
            }
            for k in 0..2 {
                f.mean[k].store_to(&mut self.center[k], first);
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
        for (list, length) in self.lists.iter_mut().zip(self.lengths) {
            list[length..length + GROUP].fill(BATCH as u8);
        }
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
fn footprints<S: Simd, const C: usize>(
    simd: S,
    entries: &[TileEntry<S::Scalar, C>],
) -> Footprint<SimdVec<S>> {
    let mut rows = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); 8];
    for j in 0..8 {
        let last = entries.len() - 1;
        let (low, block_height) = (&entries[j.min(last)].footprint, &entries[(j + 8).min(last)].footprint);
        rows[j] = SimdVec::load_eights(simd, [low, block_height]);
    }
    Footprint::of(transpose_eights(rows))
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
