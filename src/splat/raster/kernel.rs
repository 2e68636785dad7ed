//! The inner loops: a tile's splats front to back over their blocks of pixels, forward and backward.
//!
//! With `g` the loss's derivatives by a pixel's channels and `s_k = f_k . g`, the derivative by the alpha of splat
//! `k` is `T_k s_k - R_k / (1 - alpha_k)`, where `R_k` is the part of `pixel . g` that lies behind it. `R` starts as
//! `pixel . g` and loses `w_k s_k` at each splat, so the backward pass runs front to back as well, stops where the
//! forward pass stopped, and divides by no vanishing transmittance.

use super::bands::{Band, Entry};
use super::batch::{BATCH, Batch, Edges, FOUR, NUMBERS};
use super::block::{ACROSS, BLOCKS, BlockPixels, WIDE, frames, high, offset};
use super::{ALPHA_CUT, ALPHA_MAX, SATURATED};
use crate::simd::Real;
use crate::simd::{
    Exp2, MAX_LANES, Simd, SimdKernel, SimdReal, SimdVec, arrays_of_lanes, blocks_of_lines, broadcast_each,
    set_bits, sum_fours, transpose_eights, transpose_fours,
};
use std::hint::black_box;

/// Sums over the pixels of a band, or a whole image, that take the loss's derivatives back to one splat: moments, by
/// the offset from the ellipse's centre, of alpha times the derivative by alpha; and the features' derivatives.
#[derive(Clone, Copy, Debug)]
pub struct GradientSlot<T, const C: usize> {
    /// 1, x, xx, y, xy, yy.
    pub(super) moments: [T; MOMENTS],
    pub(super) feature: [T; C],
}

/// Number of moments.
const MOMENTS: usize = 6;

impl<T: Real, const C: usize> Default for GradientSlot<T, C> {
    fn default() -> Self {
        Self { moments: [T::zero(); MOMENTS], feature: [T::zero(); C] }
    }
}

impl<T: Real, const C: usize> GradientSlot<T, C> {
    /// Adds what other pixels say.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        add(&mut self.moments, other.moments);
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
struct Constants<S: Simd> {
    simd: S,
    cut: SimdVec<S>,
    saturated: SimdVec<S>,
    alpha_max: SimdVec<S>,
    zero: SimdVec<S>,
    one: SimdVec<S>,
    exp2: Exp2<S>,
}

impl<S: Simd> Constants<S> {
    #[inline(always)]
    fn new(simd: S) -> Self {
        let splat = |v: f64| SimdVec::broadcast(simd, S::Scalar::from_f64(v));
        // Hidden from the compiler: an instruction takes a row from memory at no cost, while a known number is spread
        // to all lanes anew whenever registers are short.
        black_box(Self {
            simd,
            cut: splat(ALPHA_CUT.log2()),
            saturated: splat(SATURATED),
            alpha_max: splat(ALPHA_MAX),
            zero: splat(0.0),
            one: splat(1.0),
            exp2: Exp2::new(simd),
        })
    }

    /// Alphas, before their upper limit, of some of a batch's splats at the pixels of a block.
    ///
    /// All of them before any is drawn: in so short a loop a core looks many splats ahead.
    #[inline(always)]
    fn alphas<const C: usize>(
        &self,
        batch: &Batch<S::Scalar, C>,
        splats: &[u8],
        at: &BlockPixels<S>,
        alphas: &mut [SimdVec<S>; MAX_LANES],
    ) {
        for (splat, alpha) in splats.iter().zip(alphas) {
            let exponent = batch.exponent_at(self.simd, *splat, at);
            *alpha = exponent.exp2_with(&self.exp2).select_or_zero(exponent.greater_equal(self.cut));
        }
    }

    /// Whether a pixel of a block can still be seen through.
    #[inline(always)]
    fn is_open(&self, transmittance: SimdVec<S>) -> bool {
        transmittance.greater_equal(self.saturated).any()
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

impl<T: SimdReal, const C: usize> SimdKernel<T> for Forward<'_, T, C> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { band, index, width, background, out } = self;
        let (k, pixels, edges) = (Constants::new(simd), BlockPixels::all(simd), Edges::new(simd));
        // What is filled from end to end need not be read first, and is in the cache when tiles write their parts of it.
        out.fill(T::zero());
        let background = broadcast_each(simd, background);
        let (mut batch, mut alphas) = (Batch::new(), [k.zero; MAX_LANES]);
        let mut computed = 0;
        for frame in frames(width, out.len() / ((C + 1) * width)) {
            band.warm(frame.tile);
            let mut drawn = [ForwardState { transmittance: k.one, color: [k.zero; C] }; BLOCKS];
            let mut open = frame.blocks::<S>();
            for entries in band.tile(frame.tile).chunks(BATCH) {
                batch.fill(simd, &edges, entries, frame.tile, index);
                for b in set_bits(open) {
                    let mut block = drawn[b];
                    for splats in batch.list_of(b).chunks(S::WIDTH) {
                        if !k.is_open(block.transmittance) {
                            open &= !(1 << b);
                            break;
                        }
                        computed += splats.len();
                        k.alphas(&batch, splats, &pixels[b], &mut alphas);
                        for (splat, alpha) in splats.iter().zip(&alphas) {
                            block.draw(&k, batch.features(*splat), *alpha);
                        }
                    }
                    drawn[b] = block;
                }
                if open == 0 {
                    break;
                }
            }
            for down in 0..frame.down::<S>() {
                let mut row = [k.zero; ACROSS];
                for c in 0..C {
                    for across in 0..ACROSS {
                        let block = &drawn[down * ACROSS + across];
                        row[across] = block.transmittance.mul_add(background[c], block.color[c]);
                    }
                    frame.scatter(out, C + 1, c, down, row);
                }
                for across in 0..ACROSS {
                    row[across] = drawn[down * ACROSS + across].transmittance;
                }
                frame.scatter(out, C + 1, C, down, row);
            }
        }
        band.computed_pairs = S::WIDTH * computed;
    }
}

/// A block of pixels, as far as it is drawn.
#[derive(Clone, Copy)]
struct ForwardState<S: Simd, const C: usize> {
    transmittance: SimdVec<S>,
    color: [SimdVec<S>; C],
}

impl<S: Simd, const C: usize> ForwardState<S, C> {
    /// Draws a splat behind what is there.
    #[inline(always)]
    fn draw(&mut self, k: &Constants<S>, features: [S::Scalar; C], unlimited: SimdVec<S>) {
        let alpha = unlimited.min(k.alpha_max);
        let weight = self.transmittance * alpha;
        self.transmittance = self.transmittance * (k.one - alpha);
        let features = broadcast_each(k.simd, features);
        for c in 0..C {
            self.color[c] = weight.mul_add(features[c], self.color[c]);
        }
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
    /// Room for `pixel . g` of each pixel.
    pub products: &'a mut [T],
    pub slots: &'a mut [GradientSlot<T, C>],
}

impl<T: SimdReal, const C: usize> SimdKernel<T> for Backward<'_, T, C> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { band, index, width, image, by_pixel, products, slots } = self;
        multiply::<S, C>(simd, width, image, by_pixel, products);
        let (k, pixels, edges) = (Constants::new(simd), BlockPixels::all(simd), Edges::new(simd));
        let (mut batch, mut alphas) = (Batch::new(), [k.zero; MAX_LANES]);
        let (mut taken, mut sums) = ([[k.zero; 2]; MAX_LANES], [Sums::zero(); NUMBERS]);
        for frame in frames(width, by_pixel.len() / (C * width)) {
            band.warm(frame.tile);
            let mut unseen = [BackwardState { transmittance: k.one, behind: k.zero }; BLOCKS];
            let mut by_color = [[k.zero; C]; BLOCKS];
            for down in 0..frame.down::<S>() {
                let products = frame.gather(simd, products, 1, 0, down);
                for across in 0..ACROSS {
                    unseen[down * ACROSS + across].behind = products[across];
                }
                for c in 0..C {
                    let by = frame.gather(simd, by_pixel, C, c, down);
                    for across in 0..ACROSS {
                        by_color[down * ACROSS + across][c] = by[across];
                    }
                }
            }
            let mut open = frame.blocks::<S>();
            for entries in band.tile(frame.tile).chunks(BATCH) {
                batch.fill(simd, &edges, entries, frame.tile, index);
                sums[..entries.len()].fill(Sums::zero());
                for b in set_bits(open) {
                    let mut block = unseen[b];
                    let summing = Summing::new(simd, b, &pixels[b], &by_color[b]);
                    for splats in batch.fours_of(b).chunks(S::WIDTH) {
                        if !k.is_open(block.transmittance) {
                            open &= !(1 << b);
                            break;
                        }
                        k.alphas(&batch, splats, &pixels[b], &mut alphas);
                        for ((splat, alpha), taken) in splats.iter().zip(&alphas).zip(&mut taken) {
                            *taken = block.uncover(&k, batch.features(*splat), *alpha, &by_color[b]);
                        }
                        for (splats, taken) in splats.as_chunks().0.iter().zip(taken.as_chunks().0) {
                            summing.add_to(simd, &mut sums, splats, taken);
                        }
                    }
                    unseen[b] = block;
                }
                add_to_slots(simd, &batch, entries, &sums, slots);
                if open == 0 {
                    break;
                }
            }
        }
    }
}

/// `pixel . g` of each pixel of a band.
///
/// Lines are read from end to end, as a processor is fast at; tiles then find the derivatives in the cache.
#[inline(always)]
fn multiply<S: Simd, const C: usize>(
    simd: S,
    width: usize,
    image: &[S::Scalar],
    by_pixel: &[S::Scalar],
    out: &mut [S::Scalar],
) {
    let inputs = image.chunks(width * (C + 1)).zip(by_pixel.chunks(width * C));
    for (out, (image, by_pixel)) in out.chunks_mut(width).zip(inputs) {
        for first in (0..width).step_by(S::WIDTH) {
            let mut sum = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
            for c in 0..C {
                let channel = c * width..(c + 1) * width;
                let value = SimdVec::load_from(simd, &image[channel.clone()], first);
                sum = value.mul_add(SimdVec::load_from(simd, &by_pixel[channel], first), sum);
            }
            sum.store_to(out, first);
        }
    }
}

/// What is left of a block of pixels behind the splats that were taken back.
#[derive(Clone, Copy)]
struct BackwardState<S: Simd> {
    transmittance: SimdVec<S>,
    /// Part of `pixel . g`.
    behind: SimdVec<S>,
}

impl<S: Simd> BackwardState<S> {
    /// Takes the next splat back. Gives its weight and alpha times the derivative by alpha.
    #[inline(always)]
    fn uncover<const C: usize>(
        &mut self,
        k: &Constants<S>,
        features: [S::Scalar; C],
        unlimited: SimdVec<S>,
        by_color: &[SimdVec<S>; C],
    ) -> [SimdVec<S>; 2] {
        let alpha = unlimited.min(k.alpha_max);
        let clear = k.one - alpha;
        let weight = self.transmittance * alpha;
        self.transmittance = self.transmittance * clear;
        let features = broadcast_each(k.simd, features);
        let mut along = k.zero;
        for c in 0..C {
            along = by_color[c].mul_add(features[c], along);
        }
        let own = weight * along;
        self.behind = self.behind - own;
        let odds = alpha * clear.reciprocal();
        // At the upper limit alpha no longer follows the splat.
        [weight, (own - self.behind * odds).select_or_zero(k.alpha_max.greater_equal(unlimited))]
    }
}

/// What takes a block's pixels to sums over them, four splats at a time: once columns are apart, each four of a row is a
/// row of pixels, and each of its lanes a splat.
struct Summing<S: Simd, const C: usize> {
    /// Offsets of columns from the tile's middle.
    x: [SimdVec<S>; WIDE],
    /// Their squares.
    xx: [SimdVec<S>; WIDE],
    /// Offsets of rows, and their squares.
    y: [SimdVec<S>; 2],
    /// Derivatives by each feature, by column.
    by_color: [[SimdVec<S>; WIDE]; C],
}

impl<S: Simd, const C: usize> Summing<S, C> {
    /// For block `b`.
    #[inline(always)]
    fn new(simd: S, b: usize, at: &BlockPixels<S>, by_color: &[SimdVec<S>; C]) -> Self {
        let mut offsets = [S::Scalar::from_f64(0.0); WIDE];
        for col in 0..WIDE {
            offsets[col] = offset(b % ACROSS * WIDE + col);
        }
        let x = broadcast_each(simd, offsets);
        let mut xx = x;
        for col in 0..WIDE {
            xx[col] = x[col] * x[col];
        }
        let mut columns = [x; C];
        for c in 0..C {
            // The same for each of the splats.
            columns[c] = transpose_fours([by_color[c]; FOUR]);
        }
        Self { x, xx, y: [at.y, at.yy], by_color: columns }
    }

    /// Adds sums over the block's pixels to those of four splats, whose rows are given.
    #[inline(always)]
    fn add_to(
        &self,
        simd: S,
        sums: &mut [Sums<S::Scalar>; NUMBERS],
        splats: &[u8; FOUR],
        [a, b, c, d]: &[[SimdVec<S>; 2]; FOUR],
    ) {
        const { assert!(C <= FOUR) };
        let v = transpose_fours([a[1], b[1], c[1], d[1]]);
        let w = transpose_fours([a[0], b[0], c[0], d[0]]);
        let sum = (v[0] + v[1]) + (v[2] + v[3]);
        let (x, xx) = (dot(v, self.x), dot(v, self.xx));
        let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        let mut features = [zero; 4];
        for c in 0..C {
            features[c] = dot(w, self.by_color[c]);
        }
        let [y, yy] = self.y;
        let lines = [
            sum_fours([sum, x, xx, sum * y]),
            sum_fours([x * y, sum * yy, zero, zero]),
            sum_fours(features),
            [zero; 2],
        ];
        for part in 0..MAX_LANES / S::WIDTH {
            let mut rows = [zero; 4];
            for k in 0..4 {
                rows[k] = lines[part * high::<S>() + k * S::WIDTH / MAX_LANES][k % (MAX_LANES / S::WIDTH)];
            }
            let rows = transpose_fours(blocks_of_lines(rows));
            for j in 0..4 {
                let place = &mut sums[usize::from(splats[j])].numbers;
                let sum = SimdVec::load(simd, &place[part * S::WIDTH..]) + rows[j];
                sum.store_to(place, part * S::WIDTH);
            }
        }
    }
}

/// The sum of the products, in pairs, which do not wait for each other.
#[inline(always)]
fn dot<S: Simd>(a: [SimdVec<S>; WIDE], b: [SimdVec<S>; WIDE]) -> SimdVec<S> {
    a[1].mul_add(b[1], a[0] * b[0]) + a[3].mul_add(b[3], a[2] * b[2])
}

/// Sums over a tile's pixels for one splat.
#[derive(Clone, Copy)]
struct Sums<T> {
    /// Moments 1, x, xx, y, xy, yy of alpha times the derivative by alpha, two left over, derivatives by the features.
    numbers: [T; MAX_LANES],
}

impl<T: Real> Sums<T> {
    #[inline(always)]
    fn zero() -> Self {
        Self { numbers: [T::zero(); MAX_LANES] }
    }

    #[inline(always)]
    fn moments(&self) -> &[T; 8] {
        &self.numbers.as_chunks().0[0]
    }

    #[inline(always)]
    fn by_feature(&self) -> &[T; 8] {
        &self.numbers.as_chunks().0[1]
    }
}

/// Adds a batch's sums to the slots of its splats.
#[inline(always)]
fn add_to_slots<S: Simd, const C: usize>(
    simd: S,
    batch: &Batch<S::Scalar, C>,
    entries: &[Entry<S::Scalar, C>],
    sums: &[Sums<S::Scalar>; NUMBERS],
    slots: &mut [GradientSlot<S::Scalar, C>],
) {
    for (row, entries) in entries.chunks(S::WIDTH).enumerate() {
        let sums = &sums[row * S::WIDTH..][..S::WIDTH];
        let moments = about_centers(simd, batch.centers(simd, row * S::WIDTH), sums);
        for ((entry, moments), sums) in entries.iter().zip(&moments).zip(sums) {
            let mut slot = GradientSlot::default();
            slot.moments.copy_from_slice(&moments[..MOMENTS]);
            slot.feature.copy_from_slice(&sums.by_feature()[..C]);
            slots[entry.slot as usize].add(&slot);
        }
    }
}

/// Moments about the centres of a row of splats, which lie so far from the tile's middle; two numbers are left over.
#[inline(always)]
fn about_centers<S: Simd>(
    simd: S,
    [u, v]: [SimdVec<S>; 2],
    sums: &[Sums<S::Scalar>],
) -> [[S::Scalar; 8]; MAX_LANES] {
    let mut rows = [u; 8];
    for j in 0..8 {
        rows[j] = SimdVec::load_eights(simd, [sums[j].moments(), sums[(j + 8) % S::WIDTH].moments()]);
    }
    let [sum, x, xx, y, xy, yy, ..] = transpose_eights(rows);
    let (by_x, by_y) = (x - u * sum, y - v * sum);
    arrays_of_lanes([
        sum,
        by_x,
        xx - u * (x + by_x),
        by_y,
        xy - u * y - v * by_x,
        yy - v * (y + by_y),
        sum,
        sum,
    ])
}
