//! Blocks of pixels: four columns and as many rows as fill a vector register; a tile's parts of an image in blocks.

use crate::simd::Real;
use crate::simd::{LANES, Lanes, Row, blocks_of_lines, lines_of_blocks};
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
const fn high_of(lanes: usize) -> usize {
    lanes / WIDE
}

/// Rows of a block.
#[inline(always)]
pub(super) const fn high<L: Lanes>() -> usize {
    high_of(L::WIDTH)
}

/// Blocks on top of each other in a tile.
#[inline(always)]
pub(super) const fn deep<L: Lanes>() -> usize {
    TILE / high::<L>()
}

/// Middle of a tile's columns or rows in the image.
#[inline(always)]
pub(super) fn middle<T: Real>(tile: usize) -> T {
    T::of((tile * TILE) as f64 + MIDDLE)
}

/// Offset from a tile's middle of one of its columns or rows.
#[inline(always)]
pub(super) fn offset<T: Real>(column_or_row: usize) -> T {
    T::of(column_or_row as f64 - MIDDLE)
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
    pub fn down<L: Lanes>(self) -> usize {
        self.height.div_ceil(high::<L>())
    }

    /// The blocks that have pixels, as bits.
    #[inline(always)]
    pub fn blocks<L: Lanes>(self) -> u32 {
        let row = (1u32 << self.columns().div_ceil(WIDE)) - 1;
        (0..self.down::<L>()).fold(0, |bits, down| bits | row << (down * ACROSS))
    }

    /// One channel of a row of blocks, from a band's rows of `channels`; zero outside the image.
    #[inline(always)]
    pub fn gather<L: Lanes>(
        self,
        lanes: L,
        band: &[L::Number],
        channels: usize,
        channel: usize,
        down: usize,
    ) -> [Row<L>; ACROSS] {
        let first = down * high::<L>();
        let mut lines = [Row::splat(lanes, L::Number::of(0.0)); ACROSS];
        if self.is_whole::<L>(down) {
            for k in 0..ACROSS {
                let (row, col) = (k * L::WIDTH / TILE, k * L::WIDTH % TILE);
                lines[k] = Row::load(lanes, &band[self.place(channels, channel, first + row) + col..]);
            }
        } else {
            let pixels = self.read_at_edge(band, channels, channel, first, high::<L>());
            for k in 0..ACROSS {
                lines[k] = Row::load(lanes, &pixels[k * L::WIDTH..]);
            }
        }
        blocks_of_lines(lines)
    }

    /// Writes what [`Frame::gather`] reads.
    #[inline(always)]
    pub fn scatter<L: Lanes>(
        self,
        band: &mut [L::Number],
        channels: usize,
        channel: usize,
        down: usize,
        blocks: [Row<L>; ACROSS],
    ) {
        let first = down * high::<L>();
        let lines = lines_of_blocks(blocks);
        if self.is_whole::<L>(down) {
            for k in 0..ACROSS {
                let (row, col) = (k * L::WIDTH / TILE, k * L::WIDTH % TILE);
                lines[k].store_to(band, self.place(channels, channel, first + row) + col);
            }
        } else {
            let mut pixels = [L::Number::of(0.0); ACROSS * LANES];
            for k in 0..ACROSS {
                lines[k].store_to(&mut pixels, k * L::WIDTH);
            }
            self.write_at_edge(band, channels, channel, first, high::<L>(), &pixels);
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
    fn is_whole<L: Lanes>(self, down: usize) -> bool {
        self.columns() == TILE && (down + 1) * high::<L>() <= self.height
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
    ) -> [T; ACROSS * LANES] {
        let mut pixels = [T::zero(); ACROSS * LANES];
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
        pixels: &[T; ACROSS * LANES],
    ) {
        for (row, line) in (first..self.height.min(first + count)).zip(pixels.chunks(TILE)) {
            let place = self.place(channels, channel, row);
            band[place..][..self.columns()].copy_from_slice(&line[..self.columns()]);
        }
    }
}

/// Offsets from a tile's middle of the pixels of a block, and their products.
#[derive(Clone, Copy)]
pub(super) struct BlockPixels<L: Lanes> {
    pub x: Row<L>,
    pub y: Row<L>,
    pub xx: Row<L>,
    pub xy: Row<L>,
    pub yy: Row<L>,
}

impl<L: Lanes> BlockPixels<L> {
    /// Of all blocks of a tile.
    #[inline(always)]
    pub fn all(lanes: L) -> [Self; BLOCKS] {
        let zero = Row::splat(lanes, L::Number::of(0.0));
        let mut blocks = [Self { x: zero, y: zero, xx: zero, xy: zero, yy: zero }; BLOCKS];
        for b in 0..ACROSS * deep::<L>() {
            let (across, down) = (b % ACROSS, b / ACROSS);
            let x = row_of(lanes, |i| offset(across * WIDE + i % WIDE));
            let y = row_of(lanes, |i| offset(down * high::<L>() + i / WIDE));
            blocks[b] = Self { x, y, xx: x * x, xy: x * y, yy: y * y };
        }
        // Hidden from the compiler, or it computes products anew.
        black_box(blocks)
    }
}

/// A row from numbers by lane.
#[inline(always)]
fn row_of<L: Lanes>(lanes: L, number: impl Fn(usize) -> L::Number) -> Row<L> {
    let mut values = [L::Number::of(0.0); LANES];
    for i in 0..LANES {
        values[i] = number(i);
    }
    Row::load(lanes, &values)
}
