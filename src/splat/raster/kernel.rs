//! The inner loops: a tile's splats front to back over their blocks of pixels, forward and backward.
//!
//! With `g` the loss's derivatives by a pixel's channels and `s_k = f_k . g`, the derivative by the alpha of splat
//! `k` is `T_k s_k - R_k / (1 - alpha_k)`, where `R_k` is the part of `pixel . g` that lies behind it. `R` starts as
//! `pixel . g` and loses `w_k s_k` at each splat, so the backward pass runs front to back as well, stops where the
//! forward pass stopped, and divides by no vanishing transmittance.

use super::bands::Band;
use super::block::{ACROSS, BLOCKS, BlockTest, Pixels, Stamp, across, block, each, frames};
use super::{ALPHA_CUT, ALPHA_MAX, SATURATED};
use crate::splat::lanes::{Exp2, Kernel, LANES, Lanes, Lanewise, Row, splat_each, sum_each};
use crate::splat::real::Real;
use std::hint::black_box;

/// Sums over the pixels of a band, or a whole image, that take the loss's derivatives back to one splat: moments, by
/// the offset from the ellipse's centre, of alpha times the derivative by alpha; and the features' derivatives.
#[derive(Clone, Copy, Debug)]
pub struct Slot<T, const C: usize> {
    pub(super) sum: T,
    pub(super) first: [T; 2],
    /// xx, xy, yy.
    pub(super) second: [T; 3],
    pub(super) feature: [T; C],
}

impl<T: Real, const C: usize> Default for Slot<T, C> {
    fn default() -> Self {
        let z = T::zero();
        Self { sum: z, first: [z; 2], second: [z; 3], feature: [z; C] }
    }
}

impl<T: Real, const C: usize> Slot<T, C> {
    /// Adds what other pixels say.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.sum = self.sum + other.sum;
        add(&mut self.first, other.first);
        add(&mut self.second, other.second);
        add(&mut self.feature, other.feature);
    }
}

/// Adds number by number.
#[inline(always)]
pub(super) fn add<T: Real, const N: usize>(sum: &mut [T; N], value: [T; N]) {
    for (s, v) in sum.iter_mut().zip(value) {
        *s = *s + v;
    }
}

/// What the kernels compute with.
struct Constants<L: Lanes> {
    cut: Row<L>,
    saturated: Row<L>,
    alpha_max: Row<L>,
    zero: Row<L>,
    one: Row<L>,
    exp2: Exp2<L>,
}

impl<L: Lanes> Constants<L> {
    #[inline(always)]
    fn new(lanes: L) -> Self {
        let splat = |v: f64| Row::splat(lanes, L::Number::of(v));
        // Hidden from the compiler: an instruction takes a row from memory at no cost, while a known number is spread
        // to all lanes anew whenever registers are short.
        black_box(Self {
            cut: splat(ALPHA_CUT.log2()),
            saturated: splat(SATURATED),
            alpha_max: splat(ALPHA_MAX),
            zero: splat(0.0),
            one: splat(1.0),
            exp2: Exp2::new(lanes),
        })
    }
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
        let (k, pixels, test) = (Constants::new(lanes), Pixels::new(lanes), BlockTest::new(lanes));
        let background = splat_each(lanes, background);
        for frame in frames(width, out.len() / ((C + 1) * width)) {
            let mut transmittance = [k.one; BLOCKS];
            let mut color = [[k.zero; C]; BLOCKS];
            let mut live = frame.blocks::<L>();
            for entry in band.tile_mut(frame.tile) {
                entry.blocks = live & test.touched(&entry.footprint, frame.tile, index);
            }
            for entry in band.tile(frame.tile) {
                let stamp = Stamp::new(lanes, &entry.footprint, frame.tile, index);
                let feature = splat_each(lanes, entry.feature);
                for b in each(live & entry.blocks) {
                    let t = transmittance[b];
                    if !t.at_least(k.saturated).any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let alpha = stamp.unlimited(&k, &pixels, b).min(k.alpha_max);
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
            for down in 0..frame.down() {
                let mut row = [k.zero; ACROSS];
                for c in 0..C {
                    for a in 0..across::<L>() {
                        let b = block(a, down);
                        row[a] = transmittance[b].mul_add(background[c], color[b][c]);
                    }
                    frame.scatter(out, C + 1, c, down, row);
                }
                for a in 0..across::<L>() {
                    row[a] = transmittance[block(a, down)];
                }
                frame.scatter(out, C + 1, C, down, row);
            }
        }
    }
}

/// Counts the pixels of the blocks that splats touch.
pub(super) struct Count<'a, T, const C: usize> {
    pub bands: &'a [Band<T, C>],
    pub pixels: &'a mut usize,
}

impl<T: Lanewise, const C: usize> Kernel<T> for Count<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, _: L) {
        *self.pixels = L::WIDTH * self.bands.iter().map(Band::blocks).sum::<usize>();
    }
}

/// Adds the derivatives by a band's pixels to its slots.
pub(super) struct Backward<'a, T, const C: usize> {
    pub band: &'a Band<T, C>,
    /// Which band of the image it is.
    pub index: usize,
    /// Columns of the image.
    pub width: usize,
    /// The band as it was rendered.
    pub image: &'a [T],
    pub by_pixel: &'a [T],
    pub slots: &'a mut [Slot<T, C>],
}

impl<T: Lanewise, const C: usize> Kernel<T> for Backward<'_, T, C> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { band, index, width, image, by_pixel, slots } = self;
        let (k, pixels) = (Constants::new(lanes), Pixels::new(lanes));
        for frame in frames(width, by_pixel.len() / (C * width)) {
            let mut transmittance = [k.one; BLOCKS];
            let mut behind = [k.zero; BLOCKS];
            // Of this splat and the next, in turns.
            let mut unlimited = [[k.zero; BLOCKS]; 2];
            let mut by_color = [[k.zero; C]; BLOCKS];
            for down in 0..frame.down() {
                for c in 0..C {
                    let by = frame.gather(lanes, by_pixel, C, c, down);
                    let value = frame.gather(lanes, image, C + 1, c, down);
                    for a in 0..across::<L>() {
                        let b = block(a, down);
                        by_color[b][c] = by[a];
                        behind[b] = value[a].mul_add(by[a], behind[b]);
                    }
                }
            }
            let mut live = frame.blocks::<L>();
            let entries = band.tile(frame.tile);
            if let Some(first) = entries.first() {
                let stamp = Stamp::new(lanes, &first.footprint, frame.tile, index);
                for b in each(first.blocks) {
                    unlimited[0][b] = stamp.unlimited(&k, &pixels, b);
                }
            }
            for (i, entry) in entries.iter().enumerate() {
                // One splat ahead: exponentials are computed while the way back waits for its own results.
                if let Some(next) = entries.get(i + 1) {
                    let stamp = Stamp::new(lanes, &next.footprint, frame.tile, index);
                    for b in each(live & next.blocks) {
                        unlimited[(i + 1) % 2][b] = stamp.unlimited(&k, &pixels, b);
                    }
                }
                let feature = splat_each(lanes, entry.feature);
                let mut moments = Moments::new(k.zero);
                let mut by_feature = [k.zero; C];
                for b in each(live & entry.blocks) {
                    let t = transmittance[b];
                    if !t.at_least(k.saturated).any() {
                        live &= !(1 << b);
                        continue;
                    }
                    let unlimited = unlimited[i % 2][b];
                    let alpha = unlimited.min(k.alpha_max);
                    let weight = t * alpha;
                    transmittance[b] = t - weight;
                    let mut along = k.zero;
                    for c in 0..C {
                        along = by_color[b][c].mul_add(feature[c], along);
                        by_feature[c] = by_color[b][c].mul_add(weight, by_feature[c]);
                    }
                    let own = weight * along;
                    behind[b] = behind[b] - own;
                    let odds = alpha * (k.one - alpha).reciprocal();
                    // At the upper limit alpha no longer follows the splat.
                    let by_log_alpha = (own - behind[b] * odds).keep(k.alpha_max.at_least(unlimited));
                    moments.add(by_log_alpha, &pixels, b);
                }
                let offset = entry.footprint.offset_in(frame.tile, index);
                slots[entry.slot as usize].add(&moments.slot(lanes, offset, by_feature));
                if live == 0 {
                    break;
                }
            }
        }
    }
}

impl<L: Lanes> Stamp<L> {
    /// Alpha at the pixels of a block, before its upper limit.
    #[inline(always)]
    fn unlimited(&self, k: &Constants<L>, pixels: &Pixels<L>, block: usize) -> Row<L> {
        let exponent = self.exponent(pixels, block);
        exponent.exp2_with(&k.exp2).keep(exponent.at_least(k.cut))
    }
}

/// Number of [`Moments`].
const MOMENTS: usize = 6;

/// Moments, by the offset from the tile's middle, of alpha times the derivative by alpha.
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
    fn add(&mut self, v: Row<L>, k: &Pixels<L>, block: usize) {
        let ([x, y], [xx, xy, yy]) = k.of(block);
        self.sum += v;
        self.first[0] = v.mul_add(x, self.first[0]);
        self.first[1] = v.mul_add(y, self.first[1]);
        self.second[0] = v.mul_add(xx, self.second[0]);
        self.second[1] = v.mul_add(xy, self.second[1]);
        self.second[2] = v.mul_add(yy, self.second[2]);
    }

    /// Summed over the lanes, about the ellipse's centre, whose offset from the tile's middle is given.
    #[inline(always)]
    fn slot<const C: usize>(
        self,
        lanes: L,
        [u, v]: [L::Number; 2],
        by_feature: [Row<L>; C],
    ) -> Slot<L::Number, C> {
        const { assert!(MOMENTS + C <= LANES) };
        let mut rows = [Row::splat(lanes, L::Number::of(0.0)); LANES];
        rows[0] = self.sum;
        rows[1..3].copy_from_slice(&self.first);
        rows[3..MOMENTS].copy_from_slice(&self.second);
        rows[MOMENTS..MOMENTS + C].copy_from_slice(&by_feature);
        let sums = sum_each(rows);
        let [sum, x, y, xx, xy, yy] = [sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]];
        let first = [x - u * sum, y - v * sum];
        let second = [xx - u * (x + first[0]), xy - u * y - v * first[0], yy - v * (y + first[1])];
        let mut feature = [sum; C];
        feature.copy_from_slice(&sums[MOMENTS..MOMENTS + C]);
        Slot { sum, first, second, feature }
    }
}
