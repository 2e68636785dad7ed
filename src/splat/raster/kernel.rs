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
use num_traits::Float;
use std::ops::Range;

/// Side of a tile, pixels.
pub(super) const TILE: usize = 16;
/// Side of a block, pixels.
const SIDE: usize = 4;
/// Blocks along a tile.
const ACROSS: usize = TILE / SIDE;
const BLOCKS: usize = ACROSS * ACROSS;

/// What both passes read.
pub(super) struct View<'a, T, const C: usize> {
    pub band: &'a Band<T, C>,
    /// Which band of the image it is.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
}

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

/// A splat as a tile's pixels see it.
struct Stamp<L: Lanes> {
    /// Offsets of the tile's first block's pixels from the splat's centre.
    dx: Row<L>,
    dy: Row<L>,
    /// The binary exponent is `log2_opacity + a dx² + b dx dy + c dy²`.
    quadratic: [Row<L>; 3],
    log2_opacity: Row<L>,
    /// Blocks that the ellipse's bounding box touches, as bits.
    blocks: u32,
}

impl<L: Lanes> Stamp<L> {
    #[inline(always)]
    fn new(lanes: L, [x, y]: [Row<L>; 2], f: &Footprint<L::Number>, tile: usize, band: usize) -> Self {
        let of = L::Number::of;
        let origin = [of((tile * TILE) as f64) - f.mean[0], of((band * TILE) as f64) - f.mean[1]];
        let log2_e = of(std::f64::consts::LOG2_E);
        let half = of(-0.5) * log2_e;
        // Blocks from the one that holds the first pixel to the one that holds the last.
        let touched = |k: usize| {
            let (zero, last, inverse) = (of(0.0), of((ACROSS - 1) as f64), of(1.0 / SIDE as f64));
            let first = ((-origin[k] - f.half_size[k]).ceil() * inverse).max(zero).min(last);
            let end = ((-origin[k] + f.half_size[k]).floor() * inverse).max(zero).min(last);
            (first.small(), end.small())
        };
        let ((left, right), (top, bottom)) = (touched(0), touched(1));
        let row = (2u32 << right) - (1 << left);
        let rows = (0x1111 << (4 * top)) & (0xFFFF >> (4 * (3 - bottom)));
        Self {
            dx: x + Row::splat(lanes, origin[0]),
            dy: y + Row::splat(lanes, origin[1]),
            quadratic: splat_each(lanes, [half * f.conic[0], -log2_e * f.conic[1], half * f.conic[2]]),
            log2_opacity: Row::splat(lanes, f.log2_opacity),
            blocks: row * rows,
        }
    }

    /// Binary logarithm of a block's alphas, and the offsets of its pixels from the centre.
    #[inline(always)]
    fn exponent(&self, shift: [Row<L>; 2]) -> (Row<L>, Row<L>, Row<L>) {
        let (dx, dy) = (self.dx + shift[0], self.dy + shift[1]);
        let [a, b, c] = self.quadratic;
        let along = a.mul_add(dx, b * dy);
        (along.mul_add(dx, (c * dy).mul_add(dy, self.log2_opacity)), dx, dy)
    }
}

/// What the kernels compute with: constants in registers.
struct Constants<L: Lanes> {
    /// Columns and rows of a block's pixels.
    offsets: [Row<L>; 2],
    /// Columns (rows) of blocks.
    shifts: [Row<L>; ACROSS],
    cut: Row<L>,
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
            offsets: [offset(|i| i % SIDE), offset(|i| i / SIDE)],
            shifts: std::array::from_fn(|k| splat((k * SIDE) as f64)),
            cut: splat(ALPHA_CUT.log2()),
            saturated: splat(SATURATED),
            alpha_max: splat(ALPHA_MAX),
            zero: splat(0.0),
            one: splat(1.0),
        }
    }

    #[inline(always)]
    fn shift(&self, block: usize) -> [Row<L>; 2] {
        [self.shifts[block % ACROSS], self.shifts[block / ACROSS % ACROSS]]
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

impl<T: Real, const C: usize> View<'_, T, C> {
    fn frames(&self, height: usize) -> impl Iterator<Item = Frame> {
        let width = self.width;
        (0..width.div_ceil(TILE)).map(move |tile| Frame { tile, width, height })
    }
}

/// Renders a band into `out`: rows of `C` features and the transmittance.
pub(super) struct Forward<'a, T, const C: usize> {
    pub view: View<'a, T, C>,
    pub background: [T; C],
    pub out: &'a mut [T],
}

impl<T: Lanewise, const C: usize> Kernel<T> for Forward<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { view, background, out } = self;
        let k = Constants::new(lanes);
        let background = splat_each(lanes, background);
        for frame in view.frames(out.len() / ((C + 1) * view.width)) {
            let mut transmittance = [k.one; BLOCKS];
            let mut color = [[k.zero; C]; BLOCKS];
            let mut live = frame.blocks();
            for entry in view.band.tile(frame.tile) {
                let stamp = Stamp::new(lanes, k.offsets, &entry.footprint, frame.tile, view.index);
                let feature = splat_each(lanes, entry.feature);
                for b in each(live & stamp.blocks) {
                    let t = transmittance[b];
                    let open = t.at_least(k.saturated);
                    if !open.any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let (exponent, ..) = stamp.exponent(k.shift(b));
                    let visible = exponent.at_least(k.cut).and(open);
                    if !visible.any() {
                        continue;
                    }
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
    pub view: View<'a, T, C>,
    /// The band as it was rendered.
    pub image: &'a [T],
    pub by_pixel: &'a [T],
    pub slots: &'a mut [SlotGradient<T, C>],
}

impl<T: Lanewise, const C: usize> Kernel<T> for Backward<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { view, image, by_pixel, slots } = self;
        let k = Constants::new(lanes);
        for frame in view.frames(by_pixel.len() / (C * view.width)) {
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
            let mut entries = view.band.tile(frame.tile).iter();
            for entry in entries.by_ref() {
                let stamp = Stamp::new(lanes, k.offsets, &entry.footprint, frame.tile, view.index);
                let feature = splat_each(lanes, entry.feature);
                let mut moments = Moments::new(k.zero);
                let mut by_feature = [k.zero; C];
                for b in each(live & stamp.blocks) {
                    let t = transmittance[b];
                    let open = t.at_least(k.saturated);
                    if !open.any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let (exponent, dx, dy) = stamp.exponent(k.shift(b));
                    let visible = exponent.at_least(k.cut).and(open);
                    if !visible.any() {
                        continue;
                    }
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
                    let by_alpha = t * along - behind[b].over(k.one - alpha);
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
