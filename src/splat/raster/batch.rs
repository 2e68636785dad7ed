//! Some of a tile's splats side by side, ready to be drawn: what alpha is over the tile, and which splats touch each
//! block of pixels.
//!
//! A block is drawn by itself, its pixels' state in registers from the first splat to the last; that takes a list of
//! splats for every block. Lists are made a row of splats at a time: a lane finds its splat's edges in a block's rows.

use super::bands::Entry;
use super::block::{ACROSS, BLOCKS, BlockPixels, TILE, WIDE, deep, high, middle, offset};
use super::project::Footprint;
use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdMask, SimdVec, broadcast_each, transpose_eights};

/// Numbers of a batch's splats are bytes.
pub(super) const NUMBERS: usize = 256;
/// Most splats of a batch; the number of a splat that touches nothing.
pub(super) const BATCH: usize = NUMBERS - 1;
/// Splats that are taken back together.
pub(super) const FOUR: usize = 4;
/// What is added to the squared Mahalanobis radius of the cut-off: rounding and rough roots must not lose a block.
const SLACK: f64 = 0.02;

/// Up to [`BATCH`] splats of a tile.
pub(super) struct Batch<T, const C: usize> {
    /// Coefficients 1, x, y, xx, xy, yy of alpha's binary exponent in the offset from the tile's middle.
    exponent: [[T; NUMBERS]; 6],
    /// Offsets of the splats' centres from the tile's middle.
    center: [[T; NUMBERS]; 2],
    features: [[T; C]; NUMBERS],
    /// The splats that touch each block, highest first, and some that touch nothing; room for what [`SimdMask::list`] writes
    /// beyond them.
    lists: [[u8; NUMBERS + MAX_LANES]; BLOCKS],
    lengths: [usize; BLOCKS],
}

impl<T: Real, const C: usize> Batch<T, C> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            exponent: [[T::zero(); NUMBERS]; 6],
            center: [[T::zero(); NUMBERS]; 2],
            features: [[T::zero(); C]; NUMBERS],
            lists: [[0; NUMBERS + MAX_LANES]; BLOCKS],
            lengths: [0; BLOCKS],
        }
    }

    /// Takes up splats of a tile.
    #[inline(always)]
    pub fn fill<S: Simd<Scalar = T>>(
        &mut self,
        simd: S,
        edges: &Edges<S>,
        entries: &[Entry<T, C>],
        tile: usize,
        band: usize,
    ) {
        self.lengths = [0; BLOCKS];
        let middle = broadcast_each(simd, [middle(tile), middle(band)]);
        for (k, entries) in entries.chunks(S::WIDTH).enumerate() {
            let first = k * S::WIDTH;
            for (i, entry) in entries.iter().enumerate() {
                self.features[first + i] = entry.feature;
            }
            let mut f = footprints(simd, entries);
            f.mean = [f.mean[0] - middle[0], f.mean[1] - middle[1]];
            let exponent = f.exponent(simd);
            for k in 0..6 {
                exponent[k].store_to(&mut self.exponent[k], first);
            }
            for k in 0..2 {
                f.mean[k].store_to(&mut self.center[k], first);
            }
            let ellipses = Ellipses::new(simd, &f);
            let real = SimdMask::first(simd, entries.len());
            for down in 0..deep::<S>() {
                let [left, right] = ellipses.reach(edges, down);
                for across in 0..ACROSS {
                    let [first_column, last_column] = edges.columns[across];
                    let touched =
                        right.greater_equal(first_column).and(last_column.greater_equal(left)).and(real);
                    let block = down * ACROSS + across;
                    let after = &mut self.lists[block][self.lengths[block]..];
                    self.lengths[block] += touched.compress(first as u8, after);
                }
            }
        }
        for exponent in &mut self.exponent {
            exponent[BATCH] = T::zero();
        }
        self.exponent[0][BATCH] = T::from_f64(FAR_BELOW_CUT);
        self.features[BATCH] = [T::zero(); C];
        for (list, length) in self.lists.iter_mut().zip(self.lengths) {
            list[length..length + FOUR].fill(BATCH as u8);
        }
    }

    /// The splats that touch a block, highest first.
    #[inline(always)]
    pub fn list_of(&self, block: usize) -> &[u8] {
        &self.lists[block][..self.lengths[block]]
    }

    /// As [`Batch::list_of`], with splats that touch nothing up to a multiple of [`FOUR`].
    #[inline(always)]
    pub fn fours_of(&self, block: usize) -> &[u8] {
        &self.lists[block][..self.lengths[block].next_multiple_of(FOUR)]
    }

    /// The binary exponent of a splat's alpha at the pixels of a block.
    #[inline(always)]
    pub fn exponent_at<S: Simd<Scalar = T>>(&self, simd: S, splat: u8, at: &BlockPixels<S>) -> SimdVec<S> {
        let coefficient = |k: usize| SimdVec::broadcast(simd, self.exponent[k][usize::from(splat)]);
        // Two sums, which do not wait for each other.
        let by_x = coefficient(3).mul_add(at.xx, coefficient(1).mul_add(at.x, coefficient(0)));
        let by_y = coefficient(5).mul_add(at.yy, coefficient(2) * at.y);
        coefficient(4).mul_add(at.xy, by_x) + by_y
    }

    /// Offsets from the tile's middle of the centres of a row of splats.
    #[inline(always)]
    pub fn centers<S: Simd<Scalar = T>>(&self, simd: S, first: usize) -> [SimdVec<S>; 2] {
        [SimdVec::load(simd, &self.center[0][first..]), SimdVec::load(simd, &self.center[1][first..])]
    }

    /// A splat's features.
    #[inline(always)]
    pub fn features(&self, splat: u8) -> [T; C] {
        self.features[usize::from(splat)]
    }
}

/// A binary exponent of alpha that is not drawn.
const FAR_BELOW_CUT: f64 = -100.0;

/// A row of splats, a lane each; the last one again where there are fewer.
#[inline(always)]
fn footprints<S: Simd, const C: usize>(simd: S, entries: &[Entry<S::Scalar, C>]) -> Footprint<SimdVec<S>> {
    let mut rows = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); 8];
    for j in 0..8 {
        let last = entries.len() - 1;
        let (low, high) = (&entries[j.min(last)].footprint, &entries[(j + 8).min(last)].footprint);
        rows[j] = SimdVec::load_eights(simd, [low, high]);
    }
    Footprint::of(transpose_eights(rows))
}

/// What ellipses are compared with: the edges of a tile's blocks, from the tile's middle.
pub(super) struct Edges<S: Simd> {
    /// First and last rows.
    rows: [[SimdVec<S>; 2]; BLOCKS / ACROSS],
    /// First and last columns.
    columns: [[SimdVec<S>; 2]; ACROSS],
}

impl<S: Simd> Edges<S> {
    #[inline(always)]
    pub fn new(simd: S) -> Self {
        let ends =
            |first: usize, count: usize| broadcast_each(simd, [offset(first), offset(first + count - 1)]);
        let mut rows = [ends(0, TILE); BLOCKS / ACROSS];
        for down in 0..deep::<S>() {
            rows[down] = ends(down * high::<S>(), high::<S>());
        }
        let mut columns = [rows[0]; ACROSS];
        for across in 0..ACROSS {
            columns[across] = ends(across * WIDE, WIDE);
        }
        Self { rows, columns }
    }
}

impl<S: Simd> Footprint<SimdVec<S>> {
    /// Coefficients 1, x, y, xx, xy, yy of alpha's binary exponent where the centre's offset is from.
    #[inline(always)]
    fn exponent(&self, simd: S) -> [SimdVec<S>; 6] {
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

/// A row of ellipses; centres from the tile's middle.
struct Ellipses<S: Simd> {
    mean: [SimdVec<S>; 2],
    /// The middle between left and right edge moves so far from row to row.
    slope: SimdVec<S>,
    /// On the row of the centre, half the squared width.
    square: SimdVec<S>,
    /// What it loses with the square of the distance from that row.
    drop: SimdVec<S>,
    /// Rows, from the centre, of the rightmost and the leftmost column.
    lean: [SimdVec<S>; 2],
}

impl<S: Simd> Ellipses<S> {
    #[inline(always)]
    fn new(simd: S, f: &Footprint<SimdVec<S>>) -> Self {
        let [slack, zero] = broadcast_each(simd, [SLACK, 0.0].map(S::Scalar::from_f64));
        let [a, b, c] = f.conic;
        let by_a = a.reciprocal();
        Self {
            mean: f.mean,
            slope: (zero - b) * by_a,
            square: (f.radius2 + slack) * by_a,
            drop: (a * c - b * b) * by_a * by_a,
            lean: [f.lean, zero - f.lean],
        }
    }

    /// Leftmost and rightmost columns of the ellipses in a row of blocks; not numbers where an ellipse does not reach it.
    ///
    /// An ellipse reaches furthest where it leans to, or on the row nearest to it.
    #[inline(always)]
    fn reach(&self, edges: &Edges<S>, down: usize) -> [SimdVec<S>; 2] {
        let [u, v] = self.mean;
        let [top, bottom] = [edges.rows[down][0] - v, edges.rows[down][1] - v];
        let [right, left] = [self.lean[0].max(top).min(bottom), self.lean[1].max(top).min(bottom)];
        [
            self.slope.mul_add(left, u) - self.half_width(left),
            self.slope.mul_add(right, u) + self.half_width(right),
        ]
    }

    /// Half the width on a row, from the centre; not a number beyond the ellipse.
    #[inline(always)]
    fn half_width(&self, row: SimdVec<S>) -> SimdVec<S> {
        (self.square - self.drop * row * row).sqrt_approx()
    }
}
