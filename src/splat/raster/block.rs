//! Blocks of pixels: four columns by as many rows as fill a vector register, and the layout of a tile in blocks.
//!
//! A block holds one pixel in each lane, row by row. The blocks of a tile are numbered row by row.

use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdVec, blocks_of_lines, lines_of_blocks};
use std::hint::black_box;

/// Side of a square tile, pixels.
pub const TILE: usize = 16;
/// Columns of a block, pixels.
pub(super) const BLOCK_WIDTH: usize = 4;
/// Number of blocks in a row of a tile.
pub(super) const BLOCKS_ACROSS: usize = TILE / BLOCK_WIDTH;
/// Largest number of block rows in a tile.
const MAX_BLOCKS_DOWN: usize = TILE / height_with_lanes(8);
/// Largest number of blocks in a tile.
pub(super) const MAX_BLOCKS: usize = MAX_BLOCKS_DOWN * BLOCKS_ACROSS;
/// Distance of a tile's centre from the centre of its first pixel, pixels.
const CENTER_OFFSET: f64 = 0.5 * (TILE - 1) as f64;

/// Rows of a block for a register with this number of lanes.
const fn height_with_lanes(lanes: usize) -> usize {
    lanes / BLOCK_WIDTH
}

/// Rows of a block for an instruction set.
#[inline(always)]
pub(super) const fn block_height<S: Simd>() -> usize {
    height_with_lanes(S::WIDTH)
}

/// Number of block rows in a tile for an instruction set.
#[inline(always)]
pub(super) const fn blocks_down<S: Simd>() -> usize {
    TILE / block_height::<S>()
}

/// Centre of the tile with this column or row of tiles, in image pixels.
#[inline(always)]
pub(super) fn tile_center<T: Real>(tile: usize) -> T {
    T::from_f64((tile * TILE) as f64 + CENTER_OFFSET)
}

/// Offset of a pixel column or row from the tile's centre, pixels.
#[inline(always)]
pub(super) fn offset<T: Real>(column_or_row: usize) -> T {
    T::from_f64(column_or_row as f64 - CENTER_OFFSET)
}

/// The part of a tile that lies in the image, within its band of rows.
#[derive(Clone, Copy)]
pub(super) struct TileExtent {
    /// Column of the tile, counted in tiles.
    pub tile: usize,
    /// Columns of the image.
    width: usize,
    /// Rows of the band.
    height: usize,
}

/// The tiles of a band of `height` rows in an image of `width` columns.
pub(super) fn tile_extents(width: usize, height: usize) -> impl Iterator<Item = TileExtent> {
    (0..width.div_ceil(TILE)).map(move |tile| TileExtent { tile, width, height })
}

impl TileExtent {
    /// Number of block rows that hold pixels of the image.
    #[inline(always)]
    pub fn block_rows<S: Simd>(self) -> usize {
        self.height.div_ceil(block_height::<S>())
    }

    /// Bit mask of the blocks that hold pixels of the image.
    #[inline(always)]
    pub fn blocks<S: Simd>(self) -> u32 {
        let row = (1u32 << self.columns().div_ceil(BLOCK_WIDTH)) - 1;
        (0..self.block_rows::<S>()).fold(0, |bits, down| bits | row << (down * BLOCKS_ACROSS))
    }

    /// Reads one channel of a row of blocks from a band with `channels` channels; pixels outside the image are zero.
    #[inline(always)]
    pub fn gather<S: Simd>(
        self,
        simd: S,
        band: &[S::Scalar],
        channels: usize,
        channel: usize,
        down: usize,
    ) -> [SimdVec<S>; BLOCKS_ACROSS] {
        let first = down * block_height::<S>();
        let mut lines = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); BLOCKS_ACROSS];
        if self.is_whole::<S>(down) {
            for k in 0..BLOCKS_ACROSS {
                let (row, col) = (k * S::WIDTH / TILE, k * S::WIDTH % TILE);
                lines[k] = SimdVec::load(simd, &band[self.index(channels, channel, first + row) + col..]);
            }
        } else {
            let pixels = self.read_at_edge(band, channels, channel, first, block_height::<S>());
            for k in 0..BLOCKS_ACROSS {
                lines[k] = SimdVec::load(simd, &pixels[k * S::WIDTH..]);
            }
        }
        blocks_of_lines(lines)
    }

    /// Writes one channel of a row of blocks; the inverse of [`TileExtent::gather`].
    #[inline(always)]
    pub fn scatter<S: Simd>(
        self,
        band: &mut [S::Scalar],
        channels: usize,
        channel: usize,
        down: usize,
        blocks: [SimdVec<S>; BLOCKS_ACROSS],
    ) {
        let first = down * block_height::<S>();
        let lines = lines_of_blocks(blocks);
        if self.is_whole::<S>(down) {
            for k in 0..BLOCKS_ACROSS {
                let (row, col) = (k * S::WIDTH / TILE, k * S::WIDTH % TILE);
                lines[k].store_to(band, self.index(channels, channel, first + row) + col);
            }
        } else {
            let mut pixels = [S::Scalar::from_f64(0.0); BLOCKS_ACROSS * MAX_LANES];
            for k in 0..BLOCKS_ACROSS {
                lines[k].store_to(&mut pixels, k * S::WIDTH);
            }
            self.write_at_edge(band, channels, channel, first, block_height::<S>(), &pixels);
        }
    }

    /// Index in a band with `channels` channels at which the tile's part of a row begins.
    #[inline(always)]
    fn index(self, channels: usize, channel: usize, row: usize) -> usize {
        (row * channels + channel) * self.width + self.tile * TILE
    }

    /// Columns of the tile that lie in the image.
    #[inline(always)]
    fn columns(self) -> usize {
        (self.width - self.tile * TILE).min(TILE)
    }

    /// Whether all pixels of a row of blocks lie in the image.
    #[inline(always)]
    fn is_whole<S: Simd>(self, down: usize) -> bool {
        self.columns() == TILE && (down + 1) * block_height::<S>() <= self.height
    }

    /// Reads `count` lines of the tile one after the other; pixels outside the image are zero.
    #[cold]
    #[inline(never)]
    fn read_at_edge<T: Real>(
        self,
        band: &[T],
        channels: usize,
        channel: usize,
        first: usize,
        count: usize,
    ) -> [T; BLOCKS_ACROSS * MAX_LANES] {
        let mut pixels = [T::zero(); BLOCKS_ACROSS * MAX_LANES];
        for (row, line) in (first..self.height.min(first + count)).zip(pixels.chunks_mut(TILE)) {
            let index = self.index(channels, channel, row);
            line[..self.columns()].copy_from_slice(&band[index..][..self.columns()]);
        }
        pixels
    }

    /// Writes `count` lines of the tile; pixels outside the image are skipped.
    #[cold]
    #[inline(never)]
    fn write_at_edge<T: Real>(
        self,
        band: &mut [T],
        channels: usize,
        channel: usize,
        first: usize,
        count: usize,
        pixels: &[T; BLOCKS_ACROSS * MAX_LANES],
    ) {
        for (row, line) in (first..self.height.min(first + count)).zip(pixels.chunks(TILE)) {
            let index = self.index(channels, channel, row);
            band[index..][..self.columns()].copy_from_slice(&line[..self.columns()]);
        }
    }
}

/// Offsets (x right, y down) of a block's pixels from the tile's centre, pixels, and their products.
#[derive(Clone, Copy)]
pub(super) struct BlockPixels<S: Simd> {
    pub x: SimdVec<S>,
    pub y: SimdVec<S>,
    pub xx: SimdVec<S>,
    pub xy: SimdVec<S>,
    pub yy: SimdVec<S>,
}

impl<S: Simd> BlockPixels<S> {
    /// The offsets for all blocks of a tile.
    #[inline(always)]
    pub fn all(simd: S) -> [Self; MAX_BLOCKS] {
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let mut blocks = [Self { x: zero, y: zero, xx: zero, xy: zero, yy: zero }; MAX_BLOCKS];
        for b in 0..BLOCKS_ACROSS * blocks_down::<S>() {
            let (across, down) = (b % BLOCKS_ACROSS, b / BLOCKS_ACROSS);
            let x = vector_by_lane(simd, |i| offset(across * BLOCK_WIDTH + i % BLOCK_WIDTH));
            let y = vector_by_lane(simd, |i| offset(down * block_height::<S>() + i / BLOCK_WIDTH));
            blocks[b] = Self { x, y, xx: x * x, xy: x * y, yy: y * y };
        }
        // `black_box` keeps the compiler from computing the products again wherever they are used.
        black_box(blocks)
    }
}

/// A vector whose lane `i` is `number(i)`.
#[inline(always)]
fn vector_by_lane<S: Simd>(simd: S, number: impl Fn(usize) -> S::Scalar) -> SimdVec<S> {
    let mut values = [S::Scalar::from_f64(0.0); MAX_LANES];
    for i in 0..MAX_LANES {
        values[i] = number(i);
    }
    SimdVec::load(simd, &values)
}
