//! Blocks of pixels: two rows of a tile, a vector register each. Which of them an ellipse touches, and its alpha there.

use super::project::Footprint;
use crate::splat::lanes::{LANES, Lanes, Row, splat_each};
use crate::splat::real::Real;
use std::hint::black_box;

/// Side of a tile, pixels.
pub(super) const TILE: usize = 16;
/// Rows of a block, pixels; it has as many columns as fill a register.
const HIGH: usize = 2;
/// Blocks on top of each other in a tile.
const DOWN: usize = TILE / HIGH;
/// Most blocks side by side in a tile.
pub(super) const ACROSS: usize = 4;
/// Most blocks of a tile. They are counted downwards, column by column.
pub(super) const BLOCKS: usize = DOWN * ACROSS;
/// What is added to the squared Mahalanobis radius of the cut-off: rounding and rough roots must not lose a block.
const SLACK: f64 = 0.02;
/// Offset of a tile's middle from its first pixel.
const MIDDLE: f64 = 0.5 * (TILE - 1) as f64;

/// The columns and rows of a tile that lie in the image.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub tile: usize,
    width: usize,
    height: usize,
}

impl Frame {
    /// Rows of blocks.
    #[inline(always)]
    pub fn down(self) -> usize {
        self.height.div_ceil(HIGH)
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
        let place = |r| self.place(channels, channel, down * HIGH + r);
        if self.is_whole(down) {
            join_lines(lanes, [&band[place(0)..][..TILE], &band[place(1)..][..TILE]])
        } else {
            let lines = self.lines_at_edge(band, channels, channel, down);
            join_lines(lanes, [&lines[0], &lines[1]])
        }
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
        let place = |r| self.place(channels, channel, down * HIGH + r);
        if self.is_whole(down) {
            let (above, below) = band.split_at_mut(place(1));
            split_to_lines(blocks, [&mut above[place(0)..][..TILE], &mut below[..TILE]]);
        } else {
            let [mut top, mut bottom] = [[L::Number::of(0.0); TILE]; HIGH];
            split_to_lines(blocks, [&mut top, &mut bottom]);
            self.write_at_edge(band, channels, channel, down, [top, bottom]);
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
    fn is_whole(self, down: usize) -> bool {
        self.columns() == TILE && (down + 1) * HIGH <= self.height
    }

    /// The rows of pixels of a row of blocks that is not whole.
    #[cold]
    #[inline(never)]
    fn lines_at_edge<T: Real>(
        self,
        band: &[T],
        channels: usize,
        channel: usize,
        down: usize,
    ) -> [[T; TILE]; HIGH] {
        let mut lines = [[T::zero(); TILE]; HIGH];
        for (row, line) in (down * HIGH..self.height).zip(&mut lines) {
            let pixels = &band[self.place(channels, channel, row)..][..self.columns()];
            line[..pixels.len()].copy_from_slice(pixels);
        }
        lines
    }

    #[cold]
    #[inline(never)]
    fn write_at_edge<T: Real>(
        self,
        band: &mut [T],
        channels: usize,
        channel: usize,
        down: usize,
        lines: [[T; TILE]; HIGH],
    ) {
        for (row, line) in (down * HIGH..self.height).zip(&lines) {
            let pixels = &mut band[self.place(channels, channel, row)..][..self.columns()];
            pixels.copy_from_slice(&line[..pixels.len()]);
        }
    }

    /// The blocks that have pixels, as bits.
    #[inline(always)]
    pub fn blocks<L: Lanes>(self) -> u32 {
        let column = (1u32 << self.down()) - 1;
        (0..self.columns().div_ceil(wide::<L>())).fold(0, |bits, c| bits | column << (c * DOWN))
    }
}

/// Blocks from their pixels' rows.
#[inline(always)]
fn join_lines<L: Lanes>(lanes: L, [top, bottom]: [&[L::Number]; HIGH]) -> [Row<L>; ACROSS] {
    let wide = wide::<L>();
    let mut blocks = [Row::splat(lanes, L::Number::of(0.0)); ACROSS];
    for across in 0..across::<L>() {
        let part = across * wide..(across + 1) * wide;
        blocks[across] = Row::load_halves(lanes, &top[part.clone()], &bottom[part]);
    }
    blocks
}

/// Blocks to their pixels' rows.
#[inline(always)]
fn split_to_lines<L: Lanes>(blocks: [Row<L>; ACROSS], [top, bottom]: [&mut [L::Number]; HIGH]) {
    let wide = wide::<L>();
    for across in 0..across::<L>() {
        let part = across * wide..(across + 1) * wide;
        blocks[across].store_halves(&mut top[part.clone()], &mut bottom[part]);
    }
}

/// Blocks side by side in a tile.
#[inline(always)]
pub(super) const fn across<L: Lanes>() -> usize {
    TILE / wide::<L>()
}

/// Number of a block in its tile.
#[inline(always)]
pub(super) const fn block(across: usize, down: usize) -> usize {
    across * DOWN + down
}

/// Columns of a block.
#[inline(always)]
const fn wide<L: Lanes>() -> usize {
    L::WIDTH / HIGH
}

/// A splat's binary exponent of alpha over a tile: a polynomial in the pixel's offset from the tile's middle.
pub(super) struct Stamp<L: Lanes> {
    constant: Row<L>,
    linear: [Row<L>; 2],
    /// xx, xy, yy.
    quadratic: [Row<L>; 3],
}

impl<L: Lanes> Stamp<L> {
    #[inline(always)]
    pub fn new(lanes: L, f: &Footprint<L::Number>, tile: usize, band: usize) -> Self {
        let [u, v] = f.offset_in(tile, band);
        let [a, b, c] = f.exponent();
        let twice = L::Number::of(-2.0);
        Self {
            constant: Row::splat(lanes, f.log2_opacity + (a * u + b * v) * u + c * v * v),
            linear: splat_each(lanes, [twice * a * u - b * v, twice * c * v - b * u]),
            quadratic: splat_each(lanes, [a, b, c]),
        }
    }

    /// At the pixels of a block.
    #[inline(always)]
    pub fn exponent(&self, k: &Pixels<L>, block: usize) -> Row<L> {
        let ([x, y], [xx, xy, yy]) = k.of(block);
        let e = self.linear[0].mul_add(x, self.constant);
        let e = self.quadratic[0].mul_add(xx, e);
        let e = self.linear[1].mul_add(y, e);
        let e = self.quadratic[2].mul_add(yy, e);
        self.quadratic[1].mul_add(xy, e)
    }
}

impl<T: Real> Footprint<T> {
    /// Offset of the centre from the middle of a tile, pixels.
    #[inline(always)]
    pub fn offset_in(&self, tile: usize, band: usize) -> [T; 2] {
        let middle = |k: usize| T::of((k * TILE) as f64 + MIDDLE);
        [self.mean[0] - middle(tile), self.mean[1] - middle(band)]
    }

    /// Coefficients (xx, xy, yy) of alpha's binary exponent in the offset from the centre.
    #[inline(always)]
    fn exponent(&self) -> [T; 3] {
        let log2_e = T::of(std::f64::consts::LOG2_E);
        let half = T::of(-0.5) * log2_e;
        [half * self.conic[0], -log2_e * self.conic[1], half * self.conic[2]]
    }
}

/// Offsets from a tile's middle, and their products, of the pixels of blocks: `x` by place across, `y` by place down.
pub(super) struct Pixels<L: Lanes> {
    x: [Row<L>; ACROSS],
    y: [Row<L>; DOWN],
    xx: [Row<L>; ACROSS],
    yy: [Row<L>; DOWN],
    xy: [Row<L>; BLOCKS],
}

impl<L: Lanes> Pixels<L> {
    #[inline(always)]
    pub fn new(lanes: L) -> Self {
        let zero = Row::splat(lanes, L::Number::of(0.0));
        let wide = wide::<L>();
        let mut k = Self {
            x: [zero; ACROSS],
            y: [zero; DOWN],
            xx: [zero; ACROSS],
            yy: [zero; DOWN],
            xy: [zero; BLOCKS],
        };
        for across in 0..ACROSS {
            k.x[across] = row_of(lanes, |i| (across * wide + i % wide) as f64 - MIDDLE);
            k.xx[across] = k.x[across] * k.x[across];
        }
        for down in 0..DOWN {
            k.y[down] = row_of(lanes, |i| (down * HIGH + i / wide) as f64 - MIDDLE);
            k.yy[down] = k.y[down] * k.y[down];
        }
        for block in 0..BLOCKS {
            k.xy[block] = k.x[block / DOWN] * k.y[block % DOWN];
        }
        // Hidden from the compiler, or it computes products anew.
        black_box(k)
    }

    /// A block's offsets (x, y) and products (xx, xy, yy).
    #[inline(always)]
    pub fn of(&self, block: usize) -> ([Row<L>; 2], [Row<L>; 3]) {
        let (across, down) = (block / DOWN, block % DOWN);
        ([self.x[across], self.y[down]], [self.xx[across], self.xy[block], self.yy[down]])
    }
}

/// A row from numbers by lane.
#[inline(always)]
fn row_of<L: Lanes>(lanes: L, number: impl Fn(usize) -> f64) -> Row<L> {
    let mut values = [L::Number::of(0.0); LANES];
    for i in 0..LANES {
        values[i] = L::Number::of(number(i));
    }
    Row::load(lanes, &values)
}

/// Finds the blocks that an ellipse touches: each lane looks at the blocks side by side in two rows of pixels.
pub(super) struct BlockTest<L: Lanes> {
    lanes: L,
    /// First row of pixels, from the tile's middle.
    first_row: Row<L>,
    /// First and last columns of pixels of the blocks, from the tile's middle.
    columns: [[Row<L>; 2]; ACROSS],
    /// Rows from a block's first to its last.
    last: Row<L>,
    zero: Row<L>,
}

impl<L: Lanes> BlockTest<L> {
    #[inline(always)]
    pub fn new(lanes: L) -> Self {
        let splat = |v: f64| Row::splat(lanes, L::Number::of(v));
        let zero = splat(0.0);
        let mut columns = [[zero; 2]; ACROSS];
        for across in 0..ACROSS {
            let first = (across * wide::<L>()) as f64 - MIDDLE;
            columns[across] = [splat(first), splat(first + (wide::<L>() - 1) as f64)];
        }
        Self {
            lanes,
            first_row: row_of(lanes, |i| (i % DOWN * HIGH) as f64 - MIDDLE),
            columns,
            last: splat((HIGH - 1) as f64),
            zero,
        }
    }

    /// The blocks, as bits.
    ///
    /// The ellipse reaches furthest right at `lean`, or on the row nearest to it; furthest left at `-lean`.
    #[inline(always)]
    pub fn touched(&self, f: &Footprint<L::Number>, tile: usize, band: usize) -> u32 {
        let [a, b, c] = f.conic;
        let radius2 = f.radius2 + L::Number::of(SLACK);
        let [u, v] = splat_each(self.lanes, f.offset_in(tile, band));
        let by_a = L::Number::of(1.0) / a;
        let [slope, square, drop, lean] =
            splat_each(self.lanes, [-b * by_a, radius2 * by_a, (a * c - b * b) * by_a * by_a, f.lean]);
        let top = self.first_row - v;
        let bottom = top + self.last;
        // Half the ellipse's width on a row; not a number beyond the ellipse.
        let half = |row: Row<L>| (square - drop * row * row).rough_sqrt();
        let (right, left) = (lean.max(top).min(bottom), (self.zero - lean).max(top).min(bottom));
        let right = slope.mul_add(right, half(right)) + u;
        let left = slope.mul_add(left, u - half(left));
        let mut bits = 0;
        for across in 0..across::<L>() {
            let [first, last] = self.columns[across];
            let touched = right.at_least(first).and(last.at_least(left)).bits() & ((1 << DOWN) - 1);
            bits |= touched << (across * DOWN);
        }
        bits
    }
}

/// The blocks of a set, lowest first.
#[inline(always)]
pub(super) fn each(mut blocks: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (blocks != 0).then(|| {
            let block = blocks.trailing_zeros() as usize % BLOCKS;
            blocks &= blocks - 1;
            block
        })
    })
}

/// The tiles of a band.
pub(super) fn frames(width: usize, height: usize) -> impl Iterator<Item = Frame> {
    (0..width.div_ceil(TILE)).map(move |tile| Frame { tile, width, height })
}
