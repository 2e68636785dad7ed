//! Blocks of pixels: four columns and as many rows as fill a vector register; a tile's parts of an image in blocks.

use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdVec, blocks_of_lines, lines_of_blocks};
use std::hint::black_box;

/// Side of a tile, pixels.
pub(super) const TILE: usize = 16;
/// Columns of a block, pixels.
pub(super) const WIDE: usize = 4;
/// Blocks side by side in a tile.
pub(super) const ACROSS: usize = TILE / WIDE;
/// Most blocks on top of each other in a tile.
const DEEPEST: usize = TILE / high_of(8);
/// Most blocks of a tile. They are counted row by row.
pub(super) const BLOCKS: usize = DEEPEST * ACROSS;
/// Offset of a tile's middle from its first pixel.
const MIDDLE: f64 = 0.5 * (TILE - 1) as f64;

/// Rows of a block in a register of so many lanes.
const fn high_of(simd: usize) -> usize {
    simd / WIDE
}

/// Rows of a block.
#[inline(always)]
pub(super) const fn high<S: Simd>() -> usize {
    high_of(S::WIDTH)
}

/// Blocks on top of each other in a tile.
#[inline(always)]
pub(super) const fn deep<S: Simd>() -> usize {
    TILE / high::<S>()
}

/// Middle of a tile's columns or rows in the image.
#[inline(always)]
pub(super) fn middle<T: Real>(tile: usize) -> T {
    T::from_f64((tile * TILE) as f64 + MIDDLE)
}

/// Offset from a tile's middle of one of its columns or rows.
#[inline(always)]
pub(super) fn offset<T: Real>(column_or_row: usize) -> T {
    T::from_f64(column_or_row as f64 - MIDDLE)
}

/// The columns and rows of a tile that lie in the image.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub tile: usize,
    width: usize,
    height: usize,
}

/// The tiles of a band of this size.
pub(super) fn frames(width: usize, height: usize) -> impl Iterator<Item = Frame> {
    (0..width.div_ceil(TILE)).map(move |tile| Frame { tile, width, height })
}

impl Frame {
    /// Rows of blocks.
    #[inline(always)]
    pub fn down<S: Simd>(self) -> usize {
        self.height.div_ceil(high::<S>())
    }

    /// The blocks that have pixels, as bits.
    #[inline(always)]
    pub fn blocks<S: Simd>(self) -> u32 {
        let row = (1u32 << self.columns().div_ceil(WIDE)) - 1;
        (0..self.down::<S>()).fold(0, |bits, down| bits | row << (down * ACROSS))
    }

    /// One channel of a row of blocks, from a band's rows of `channels`; zero outside the image.
    #[inline(always)]
    pub fn gather<S: Simd>(
        self,
        simd: S,
        band: &[S::Scalar],
        channels: usize,
        channel: usize,
        down: usize,
    ) -> [SimdVec<S>; ACROSS] {
        let first = down * high::<S>();
        let mut lines = [SimdVec::broadcast(simd, S::Scalar::from_f64(0.0)); ACROSS];
        if self.is_whole::<S>(down) {
            for k in 0..ACROSS {
                let (row, col) = (k * S::WIDTH / TILE, k * S::WIDTH % TILE);
                lines[k] = SimdVec::load(simd, &band[self.place(channels, channel, first + row) + col..]);
            }
        } else {
            let pixels = self.read_at_edge(band, channels, channel, first, high::<S>());
            for k in 0..ACROSS {
                lines[k] = SimdVec::load(simd, &pixels[k * S::WIDTH..]);
            }
        }
        blocks_of_lines(lines)
    }

    /// Writes what [`Frame::gather`] reads.
    #[inline(always)]
    pub fn scatter<S: Simd>(
        self,
        band: &mut [S::Scalar],
        channels: usize,
        channel: usize,
        down: usize,
        blocks: [SimdVec<S>; ACROSS],
    ) {
        let first = down * high::<S>();
        let lines = lines_of_blocks(blocks);
        if self.is_whole::<S>(down) {
            for k in 0..ACROSS {
                let (row, col) = (k * S::WIDTH / TILE, k * S::WIDTH % TILE);
                lines[k].store_to(band, self.place(channels, channel, first + row) + col);
            }
        } else {
            let mut pixels = [S::Scalar::from_f64(0.0); ACROSS * MAX_LANES];
            for k in 0..ACROSS {
                lines[k].store_to(&mut pixels, k * S::WIDTH);
            }
            self.write_at_edge(band, channels, channel, first, high::<S>(), &pixels);
        }
    }

    /// Where the tile's part of a row begins in a band's rows of `channels`.
    #[inline(always)]
    fn place(self, channels: usize, channel: usize, row: usize) -> usize {
        (row * channels + channel) * self.width + self.tile * TILE
    }

    /// Columns of the tile.
    #[inline(always)]
    fn columns(self) -> usize {
        (self.width - self.tile * TILE).min(TILE)
    }

    /// Whether all pixels of a row of blocks lie in the image.
    #[inline(always)]
    fn is_whole<S: Simd>(self, down: usize) -> bool {
        self.columns() == TILE && (down + 1) * high::<S>() <= self.height
    }

    /// Some lines of the tile, one after the other, as far as they lie in the image.
    #[cold]
    #[inline(never)]
    fn read_at_edge<T: Real>(
        self,
        band: &[T],
        channels: usize,
        channel: usize,
        first: usize,
        count: usize,
    ) -> [T; ACROSS * MAX_LANES] {
        let mut pixels = [T::zero(); ACROSS * MAX_LANES];
        for (row, line) in (first..self.height.min(first + count)).zip(pixels.chunks_mut(TILE)) {
            let place = self.place(channels, channel, row);
            line[..self.columns()].copy_from_slice(&band[place..][..self.columns()]);
        }
        pixels
    }

    /// Writes what [`Frame::read_at_edge`] reads.
    #[cold]
    #[inline(never)]
    fn write_at_edge<T: Real>(
        self,
        band: &mut [T],
        channels: usize,
        channel: usize,
        first: usize,
        count: usize,
        pixels: &[T; ACROSS * MAX_LANES],
    ) {
        for (row, line) in (first..self.height.min(first + count)).zip(pixels.chunks(TILE)) {
            let place = self.place(channels, channel, row);
            band[place..][..self.columns()].copy_from_slice(&line[..self.columns()]);
        }
    }
}

/// Offsets from a tile's middle of the pixels of a block, and their products.
#[derive(Clone, Copy)]
pub(super) struct BlockPixels<S: Simd> {
    pub x: SimdVec<S>,
    pub y: SimdVec<S>,
    pub xx: SimdVec<S>,
    pub xy: SimdVec<S>,
    pub yy: SimdVec<S>,
}

impl<S: Simd> BlockPixels<S> {
    /// Of all blocks of a tile.
    #[inline(always)]
    pub fn all(simd: S) -> [Self; BLOCKS] {
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let mut blocks = [Self { x: zero, y: zero, xx: zero, xy: zero, yy: zero }; BLOCKS];
        for b in 0..ACROSS * deep::<S>() {
            let (across, down) = (b % ACROSS, b / ACROSS);
            let x = row_of(simd, |i| offset(across * WIDE + i % WIDE));
            let y = row_of(simd, |i| offset(down * high::<S>() + i / WIDE));
            blocks[b] = Self { x, y, xx: x * x, xy: x * y, yy: y * y };
        }
        // Hidden from the compiler, or it computes products anew.
        black_box(blocks)
    }
}

/// A row from numbers by lane.
#[inline(always)]
fn row_of<S: Simd>(simd: S, number: impl Fn(usize) -> S::Scalar) -> SimdVec<S> {
    let mut values = [S::Scalar::from_f64(0.0); MAX_LANES];
    for i in 0..MAX_LANES {
        values[i] = number(i);
    }
    SimdVec::load(simd, &values)
}
