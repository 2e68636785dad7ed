//! The inner loops: blocks of 4 × 4 pixels, a vector register each, front to back, forward and backward.
//!
//! A block is as often missed by a small ellipse as a row of sixteen pixels is hit in vain.
//!
//! With `g` the loss's derivatives by a pixel's channels and `s_k = f_k . g`, the derivative by the alpha of splat
//! `k` is `T_k s_k - R_k / (1 - alpha_k)`, where `R_k` is the part of `pixel . g` that lies behind it. `R` starts as
//! `pixel . g` and loses `w_k s_k` at each splat, so the backward pass runs front to back as well, stops where the
//! forward pass stopped, and divides by no vanishing transmittance.

use super::bands::Band;
use super::project::Footprint;
use super::{ALPHA_CUT, ALPHA_MAX, SATURATED};
use crate::splat::lanes::{Kernel, LANES, Lanes, Lanewise, Row, splat_each, sum_each};
use crate::splat::real::Real;
use std::ops::Range;

/// Side of a tile, pixels.
pub(super) const TILE: usize = 16;
/// Side of a block, pixels.
const SIDE: usize = 4;
/// Blocks along a tile.
const ACROSS: usize = TILE / SIDE;
const BLOCKS: usize = ACROSS * ACROSS;

/// Derivatives of the loss by one splat as one tile sees it.
#[derive(Clone, Copy, Debug)]
pub struct SlotGradient<T, const C: usize> {
    /// Sum of alpha times the derivative by alpha.
    pub(super) alpha: T,
    pub(super) mean: [T; 2],
    pub(super) conic: [T; 3],
    pub(super) feature: [T; C],
}

impl<T: Real, const C: usize> Default for SlotGradient<T, C> {
    fn default() -> Self {
        let z = T::zero();
        Self { alpha: z, mean: [z; 2], conic: [z; 3], feature: [z; C] }
    }
}

/// The columns and rows of a tile that lie in the image.
#[derive(Clone, Copy)]
struct Frame {
    tile: usize,
    width: usize,
    height: usize,
}

impl Frame {
    /// Pixels of block `b` in one channel of a band's rows of `channels`; zero outside the image.
    #[inline(always)]
    fn gather<T: Real>(self, band: &[T], channels: usize, channel: usize, b: usize) -> [T; LANES] {
        let mut out = [T::zero(); LANES];
        self.each_row(channels, channel, b, |lanes, place| out[lanes].copy_from_slice(&band[place]));
        out
    }

    /// Writes a block's pixels.
    #[inline(always)]
    fn scatter<T: Real>(self, band: &mut [T], channels: usize, channel: usize, b: usize, values: [T; LANES]) {
        self.each_row(channels, channel, b, |lanes, place| band[place].copy_from_slice(&values[lanes]));
    }

    /// Visits the rows of a block: their lanes, and their place in the band.
    #[inline(always)]
    fn each_row(
        self,
        channels: usize,
        channel: usize,
        b: usize,
        mut visit: impl FnMut(Range<usize>, Range<usize>),
    ) {
        let col = self.tile * TILE + b % ACROSS * SIDE;
        let row = b / ACROSS * SIDE;
        let place = |r: usize| ((row + r) * channels + channel) * self.width + col;
        if col + SIDE <= self.width && row + SIDE <= self.height {
            for r in 0..SIDE {
                visit(r * SIDE..(r + 1) * SIDE, place(r)..place(r) + SIDE);
            }
        } else if col < self.width {
            let columns = SIDE.min(self.width - col);
            for r in 0..SIDE.min(self.height.saturating_sub(row)) {
                visit(r * SIDE..r * SIDE + columns, place(r)..place(r) + columns);
            }
        }
    }

    /// The blocks that have pixels, as bits.
    #[inline(always)]
    fn blocks(self) -> u32 {
        let columns = (self.width - self.tile * TILE).min(TILE).div_ceil(SIDE);
        let row = (1u32 << columns) - 1;
        (0..self.height.div_ceil(SIDE)).fold(0, |bits, r| bits | row << (r * ACROSS))
    }
}

/// A splat's binary exponent of alpha, `log2_opacity + a dx² + b dx dy + c dy²`.
struct Stamp<L: Lanes> {
    /// Offset of the tile's first pixel from the splat's centre.
    origin: [Row<L>; 2],
    quadratic: [Row<L>; 3],
    log2_opacity: Row<L>,
}

impl<L: Lanes> Stamp<L> {
    #[inline(always)]
    fn new(lanes: L, f: &Footprint<L::Number>, tile: usize, band: usize) -> Self {
        let of = L::Number::of;
        let log2_e = of(std::f64::consts::LOG2_E);
        let half = of(-0.5) * log2_e;
        Self {
            origin: splat_each(
                lanes,
                [of((tile * TILE) as f64) - f.mean[0], of((band * TILE) as f64) - f.mean[1]],
            ),
            quadratic: splat_each(lanes, [half * f.conic[0], -log2_e * f.conic[1], half * f.conic[2]]),
            log2_opacity: Row::splat(lanes, f.log2_opacity),
        }
    }

    #[inline(always)]
    fn exponent(&self, dx: Row<L>, dy: Row<L>) -> Row<L> {
        let [a, b, c] = self.quadratic;
        a.mul_add(dx, b * dy).mul_add(dx, (c * dy).mul_add(dy, self.log2_opacity))
    }

    /// The blocks that the ellipse touches, as bits: each lane looks at a block.
    ///
    /// The exponent's maximum over a block lies where it is greatest on one of the lines through the column, or the
    /// row, that is nearest to the centre.
    #[inline(always)]
    fn blocks(&self, k: &Constants<L>) -> u32 {
        let [a, b, c] = self.quadratic;
        let (left, top) = (self.origin[0] + k.blocks[0], self.origin[1] + k.blocks[1]);
        let (right, bottom) = (left + k.last, top + k.last);
        let (x, y) = (left.max(k.zero).min(right), top.max(k.zero).min(bottom));
        let (down, along) = (k.minus_half * b.over(c), k.minus_half * b.over(a));
        let in_column = self.exponent(x, (down * x).max(top).min(bottom));
        let in_row = self.exponent((along * y).max(left).min(right), y);
        k.bits.keep(in_column.max(in_row).at_least(k.cut_with_margin)).sum().small()
    }
}

/// What the kernels compute with: constants in registers.
struct Constants<L: Lanes> {
    /// Columns and rows of a block's pixels.
    pixels: [Row<L>; 2],
    /// First column and row of every block, in a lane each.
    blocks: [Row<L>; 2],
    /// Last column and row of a block.
    last: Row<L>,
    /// Powers of two.
    bits: Row<L>,
    /// Columns (rows) of blocks.
    shifts: [Row<L>; ACROSS],
    cut: Row<L>,
    /// As `cut`, but rounding must not lose a block.
    cut_with_margin: Row<L>,
    minus_half: Row<L>,
    saturated: Row<L>,
    alpha_max: Row<L>,
    zero: Row<L>,
    one: Row<L>,
}

impl<L: Lanes> Constants<L> {
    #[inline(always)]
    fn new(lanes: L) -> Self {
        let splat = |v: f64| Row::splat(lanes, L::Number::of(v));
        let offset =
            |f: fn(usize) -> usize| Row::load(lanes, &std::array::from_fn(|i| L::Number::of(f(i) as f64)));
        Self {
            pixels: [offset(|i| i % SIDE), offset(|i| i / SIDE)],
            blocks: [offset(|i| i % ACROSS * SIDE), offset(|i| i / ACROSS * SIDE)],
            last: splat((SIDE - 1) as f64),
            bits: offset(|i| 1 << i),
            shifts: std::array::from_fn(|k| splat((k * SIDE) as f64)),
            cut: splat(ALPHA_CUT.log2()),
            cut_with_margin: splat(ALPHA_CUT.log2() - 0.01),
            minus_half: splat(-0.5),
            saturated: splat(SATURATED),
            alpha_max: splat(ALPHA_MAX),
            zero: splat(0.0),
            one: splat(1.0),
        }
    }

    /// Offsets of a block's pixels from the splat's centre.
    #[inline(always)]
    fn offsets(&self, stamp: &Stamp<L>, block: usize) -> (Row<L>, Row<L>) {
        let shift = |axis: usize, k: usize| self.pixels[axis] + self.shifts[k % ACROSS];
        (stamp.origin[0] + shift(0, block), stamp.origin[1] + shift(1, block / ACROSS))
    }
}

/// The blocks of a set, lowest first.
#[inline(always)]
fn each(mut blocks: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (blocks != 0).then(|| {
            let block = blocks.trailing_zeros() as usize % BLOCKS;
            blocks &= blocks - 1;
            block
        })
    })
}

/// The tiles of a band.
fn frames(width: usize, height: usize) -> impl Iterator<Item = Frame> {
    (0..width.div_ceil(TILE)).map(move |tile| Frame { tile, width, height })
}

/// Renders a band into `out`: rows of `C` features and the transmittance.
pub(super) struct Forward<'a, T, const C: usize> {
    pub band: &'a mut Band<T, C>,
    /// Which band of the image it is.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    pub background: [T; C],
    pub out: &'a mut [T],
}

impl<T: Lanewise, const C: usize> Kernel<T> for Forward<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { band, index, width, background, out } = self;
        let k = Constants::new(lanes);
        let background = splat_each(lanes, background);
        for frame in frames(width, out.len() / ((C + 1) * width)) {
            let mut transmittance = [k.one; BLOCKS];
            let mut color = [[k.zero; C]; BLOCKS];
            for entry in band.tile_mut(frame.tile) {
                entry.blocks = Stamp::new(lanes, &entry.footprint, frame.tile, index).blocks(&k);
            }
            let mut live = frame.blocks();
            for entry in band.tile(frame.tile) {
                let stamp = Stamp::new(lanes, &entry.footprint, frame.tile, index);
                let feature = splat_each(lanes, entry.feature);
                for b in each(live & entry.blocks) {
                    let t = transmittance[b];
                    let open = t.at_least(k.saturated);
                    if !open.any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let (dx, dy) = k.offsets(&stamp, b);
                    let exponent = stamp.exponent(dx, dy);
                    let visible = exponent.at_least(k.cut).and(open);
                    let alpha = exponent.exp2().min(k.alpha_max).keep(visible);
                    let weight = t * alpha;
                    transmittance[b] = t - weight;
                    for c in 0..C {
                        color[b][c] = weight.mul_add(feature[c], color[b][c]);
                    }
                }
                if live == 0 {
                    break;
                }
            }
            for b in each(frame.blocks()) {
                for c in 0..C {
                    let value = transmittance[b].mul_add(background[c], color[b][c]);
                    frame.scatter(out, C + 1, c, b, value.store());
                }
                frame.scatter(out, C + 1, C, b, transmittance[b].store());
            }
        }
    }
}

/// Fills a band's slots from the derivatives by its pixels.
pub(super) struct Backward<'a, T, const C: usize> {
    pub band: &'a Band<T, C>,
    /// Which band of the image it is.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    /// The band as it was rendered.
    pub image: &'a [T],
    pub by_pixel: &'a [T],
    pub slots: &'a mut [SlotGradient<T, C>],
}

impl<T: Lanewise, const C: usize> Kernel<T> for Backward<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { band, index, width, image, by_pixel, slots } = self;
        let k = Constants::new(lanes);
        for frame in frames(width, by_pixel.len() / (C * width)) {
            let mut transmittance = [k.one; BLOCKS];
            let mut behind = [k.zero; BLOCKS];
            let mut by_color = [[k.zero; C]; BLOCKS];
            for b in each(frame.blocks()) {
                for c in 0..C {
                    by_color[b][c] = Row::load(lanes, &frame.gather(by_pixel, C, c, b));
                    let value = Row::load(lanes, &frame.gather(image, C + 1, c, b));
                    behind[b] = value.mul_add(by_color[b][c], behind[b]);
                }
            }
            let mut live = frame.blocks();
            let mut entries = band.tile(frame.tile).iter();
            for entry in entries.by_ref() {
                let stamp = Stamp::new(lanes, &entry.footprint, frame.tile, index);
                let feature = splat_each(lanes, entry.feature);
                let mut moments = Moments::new(k.zero);
                let mut by_feature = [k.zero; C];
                for b in each(live & entry.blocks) {
                    let t = transmittance[b];
                    let open = t.at_least(k.saturated);
                    if !open.any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let (dx, dy) = k.offsets(&stamp, b);
                    let exponent = stamp.exponent(dx, dy);
                    let visible = exponent.at_least(k.cut).and(open);
                    let unlimited = exponent.exp2().keep(visible);
                    let alpha = unlimited.min(k.alpha_max);
                    let weight = t * alpha;
                    transmittance[b] = t - weight;
                    let mut along = k.zero;
                    for c in 0..C {
                        along = by_color[b][c].mul_add(feature[c], along);
                        by_feature[c] = by_color[b][c].mul_add(weight, by_feature[c]);
                    }
                    behind[b] = behind[b] - weight * along;
                    let by_alpha = t * along - behind[b] * (k.one - alpha).reciprocal();
                    // At the upper limit alpha no longer follows the splat.
                    moments.add((by_alpha * alpha).keep(k.alpha_max.at_least(unlimited)), dx, dy);
                }
                slots[entry.slot as usize] = moments.slot(entry.footprint.conic, by_feature);
                if live == 0 {
                    break;
                }
            }
            for hidden in entries {
                slots[hidden.slot as usize] = SlotGradient::default();
            }
        }
    }
}

/// Moments, by the offset from the splat's centre, of alpha times the derivative by alpha.
struct Moments<L: Lanes> {
    sum: Row<L>,
    first: [Row<L>; 2],
    /// xx, xy, yy.
    second: [Row<L>; 3],
}

impl<L: Lanes> Moments<L> {
    #[inline(always)]
    fn new(zero: Row<L>) -> Self {
        Self { sum: zero, first: [zero; 2], second: [zero; 3] }
    }

    #[inline(always)]
    fn add(&mut self, v: Row<L>, dx: Row<L>, dy: Row<L>) {
        let (x, y) = (v * dx, v * dy);
        self.sum += v;
        self.first[0] += x;
        self.first[1] += y;
        self.second[0] = x.mul_add(dx, self.second[0]);
        self.second[1] = x.mul_add(dy, self.second[1]);
        self.second[2] = y.mul_add(dy, self.second[2]);
    }

    /// Derivatives by the ellipse's centre and conic.
    #[inline(always)]
    fn slot<const C: usize>(
        self,
        [a, b, c]: [L::Number; 3],
        by_feature: [Row<L>; C],
    ) -> SlotGradient<L::Number, C> {
        let [x, y] = sum_each(self.first);
        let [xx, xy, yy] = sum_each(self.second);
        let half = L::Number::of(0.5);
        SlotGradient {
            alpha: self.sum.sum(),
            mean: [a * x + b * y, b * x + c * y],
            conic: [-half * xx, -xy, -half * yy],
            feature: sum_each(by_feature),
        }
    }
}
