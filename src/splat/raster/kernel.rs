//! The inner loops: sixteen pixels at a time, front to back, forward and backward.
//!
//! With `g` the loss's derivatives by a pixel's channels and `s_k = f_k . g`, the derivative by the alpha of splat
//! `k` is `T_k s_k - R_k / (1 - alpha_k)`, where `R_k` is the part of `pixel . g` that lies behind it. `R` starts as
//! `pixel . g` and loses `w_k s_k` at each splat, so the backward pass runs front to back as well, stops where the
//! forward pass stopped, and divides by no vanishing transmittance.

use super::bands::{Band, Entry};
use super::project::Chunk;
use super::{ALPHA_CUT, ALPHA_MAX, SATURATED};
use crate::splat::real::Real;
use multiversion::multiversion;
use multiversion::target::target_cfg_f;

/// Side of a tile, pixels: one AVX-512 register of f32.
pub(super) const TILE: usize = 16;
/// Splats after which a tile looks which of its rows are saturated.
const LOOK_EVERY: usize = 8;

type Lane<T> = [T; TILE];
type Square<T> = [Lane<T>; TILE];

/// What both passes read.
pub struct View<'a, T, const C: usize> {
    pub(super) band: &'a Band<T, C>,
    pub(super) chunks: &'a [Chunk<T>],
    pub(super) features: &'a [[T; C]],
    /// Which band of the image it is.
    pub(super) index: usize,
    /// Columns of the image.
    pub(super) width: usize,
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

/// The passes over one band, compiled for the numbers and the processor at hand.
pub trait Kernels<const C: usize>: Real {
    /// Renders the band into `out`: rows of `C` features and the transmittance.
    fn forward(view: &View<Self, C>, background: [Self; C], out: &mut [Self]);
    /// Fills the band's slots.
    fn backward(view: &View<Self, C>, image: &[Self], by_pixel: &[Self], slots: &mut [SlotGradient<Self, C>]);
}

impl<const C: usize> Kernels<C> for f64 {
    fn forward(view: &View<Self, C>, background: [Self; C], out: &mut [Self]) {
        forward_band::<f64, C, false>(view, background, out);
    }
    fn backward(
        view: &View<Self, C>,
        image: &[Self],
        by_pixel: &[Self],
        slots: &mut [SlotGradient<Self, C>],
    ) {
        backward_band::<f64, C, false>(view, image, by_pixel, slots);
    }
}

impl<const C: usize> Kernels<C> for f32 {
    fn forward(view: &View<Self, C>, background: [Self; C], out: &mut [Self]) {
        forward_f32(view, background, out);
    }
    fn backward(
        view: &View<Self, C>,
        image: &[Self],
        by_pixel: &[Self],
        slots: &mut [SlotGradient<Self, C>],
    ) {
        backward_f32(view, image, by_pixel, slots);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn forward_f32<const C: usize>(view: &View<'_, f32, C>, background: [f32; C], out: &mut [f32]) {
    if target_cfg_f!(target_feature = "fma") {
        forward_band::<f32, C, true>(view, background, out);
    } else {
        forward_band::<f32, C, false>(view, background, out);
    }
}

#[multiversion(targets("x86_64+avx512f+avx512bw+avx512dq+avx512vl+avx2+fma", "x86_64+avx2+fma"))]
fn backward_f32<const C: usize>(
    view: &View<'_, f32, C>,
    image: &[f32],
    by_pixel: &[f32],
    slots: &mut [SlotGradient<f32, C>],
) {
    if target_cfg_f!(target_feature = "fma") {
        backward_band::<f32, C, true>(view, image, by_pixel, slots);
    } else {
        backward_band::<f32, C, false>(view, image, by_pixel, slots);
    }
}

/// A splat as a tile's pixels see it: the exponent is a quadratic of the row for each column.
struct Stamp<T> {
    /// Pixel column minus the splat's centre.
    dx: Lane<T>,
    /// Row 0 of the tile minus the splat's centre.
    dy0: T,
    /// Binary exponent at dy = 0, its slope, its curvature.
    at_zero: Lane<T>,
    slope: Lane<T>,
    curvature: T,
    rows: std::ops::Range<usize>,
}

impl<T: Real> Stamp<T> {
    #[inline(always)]
    fn new<const C: usize>(view: &View<'_, T, C>, entry: Entry, tile: usize, height: usize) -> (Self, usize) {
        let f = &view.chunks[entry.chunk as usize].footprints[entry.footprint as usize];
        let log2_e = T::of(std::f64::consts::LOG2_E);
        let half = T::of(-0.5);
        let dx0 = T::of((tile * TILE) as f64) - f.mean[0];
        let dy0 = T::of((view.index * TILE) as f64) - f.mean[1];
        let (a, b, c) = (half * log2_e * f.conic[0], -log2_e * f.conic[1], half * log2_e * f.conic[2]);
        let mut dx = [T::zero(); TILE];
        let mut at_zero = dx;
        let mut slope = dx;
        for i in 0..TILE {
            dx[i] = dx0 + T::of(i as f64);
            at_zero[i] = f.log2_opacity + a * dx[i] * dx[i];
            slope[i] = b * dx[i];
        }
        let last = T::of(height as f64 - 1.0);
        let first = (-dy0 - f.half_rows).ceil().max(T::zero()).min(last + T::one());
        let end = (-dy0 + f.half_rows).floor().min(last) + T::one();
        let rows = first.wide() as usize..end.wide().max(0.0) as usize;
        (Self { dx, dy0, at_zero, slope, curvature: c, rows }, f.rank as usize)
    }

    /// Alphas of a row of pixels before the upper limit, zero below the cut-off; none if all are.
    #[inline(always)]
    fn alpha<const FMA: bool>(&self, dy: T) -> Option<Lane<T>> {
        let cut = T::of(ALPHA_CUT.log2());
        let mut exponent = [T::zero(); TILE];
        let mut any = false;
        for i in 0..TILE {
            let inner = self.curvature.madd::<FMA>(dy, self.slope[i]);
            exponent[i] = inner.madd::<FMA>(dy, self.at_zero[i]);
            any |= exponent[i] >= cut;
        }
        if !any {
            return None;
        }
        let mut alpha = [T::zero(); TILE];
        for i in 0..TILE {
            let value = exponent[i].max(cut).exp2_lane::<FMA>();
            alpha[i] = if exponent[i] >= cut { value } else { T::zero() };
        }
        Some(alpha)
    }
}

/// Rows of which some pixel still lets light through.
#[inline(always)]
fn live_rows<T: Real>(transmittance: &Square<T>, height: usize) -> u32 {
    let saturated = T::of(SATURATED);
    let mut live = 0;
    for (r, row) in transmittance.iter().enumerate().take(height) {
        let mut any = false;
        for t in row {
            any |= *t >= saturated;
        }
        live |= u32::from(any) << r;
    }
    live
}

#[inline(always)]
fn forward_band<T: Real, const C: usize, const FMA: bool>(
    view: &View<'_, T, C>,
    background: [T; C],
    out: &mut [T],
) {
    let width = view.width;
    let height = out.len() / ((C + 1) * width);
    let (saturated, alpha_max) = (T::of(SATURATED), T::of(ALPHA_MAX));
    for tile in 0..width.div_ceil(TILE) {
        let mut transmittance = [[T::one(); TILE]; TILE];
        let mut color = [[[T::zero(); TILE]; TILE]; C];
        let mut live = (1u32 << height) - 1;
        for (n, &entry) in view.band.tile(tile).iter().enumerate() {
            if n % LOOK_EVERY == LOOK_EVERY - 1 {
                live = live_rows(&transmittance, height);
                if live == 0 {
                    break;
                }
            }
            let (stamp, rank) = Stamp::new(view, entry, tile, height);
            let feature = view.features[rank];
            for r in stamp.rows.clone() {
                if live >> r & 1 == 0 {
                    continue;
                }
                let Some(alpha) = stamp.alpha::<FMA>(stamp.dy0 + T::of(r as f64)) else { continue };
                let row = &mut transmittance[r & (TILE - 1)];
                let mut weight = [T::zero(); TILE];
                for i in 0..TILE {
                    let open = if row[i] >= saturated { row[i] } else { T::zero() };
                    weight[i] = open * alpha[i].min(alpha_max);
                    row[i] = row[i] - weight[i];
                }
                for c in 0..C {
                    let row = &mut color[c][r & (TILE - 1)];
                    for i in 0..TILE {
                        row[i] = weight[i].madd::<FMA>(feature[c], row[i]);
                    }
                }
            }
        }
        let columns = TILE.min(width - tile * TILE);
        for r in 0..height {
            for c in 0..C {
                let start = (r * (C + 1) + c) * width + tile * TILE;
                for (i, v) in out[start..start + columns].iter_mut().enumerate() {
                    *v = color[c][r][i] + transmittance[r][i] * background[c];
                }
            }
            let start = (r * (C + 1) + C) * width + tile * TILE;
            out[start..start + columns].copy_from_slice(&transmittance[r][..columns]);
        }
    }
}

#[inline(always)]
fn backward_band<T: Real, const C: usize, const FMA: bool>(
    view: &View<'_, T, C>,
    image: &[T],
    by_pixel: &[T],
    slots: &mut [SlotGradient<T, C>],
) {
    let width = view.width;
    let height = by_pixel.len() / (C * width);
    let (saturated, alpha_max, one) = (T::of(SATURATED), T::of(ALPHA_MAX), T::one());
    for tile in 0..width.div_ceil(TILE) {
        let mut transmittance = [[one; TILE]; TILE];
        let mut behind = [[T::zero(); TILE]; TILE];
        let mut by_color = [[[T::zero(); TILE]; TILE]; C];
        let columns = TILE.min(width - tile * TILE);
        for r in 0..height {
            for c in 0..C {
                let start = (r * C + c) * width + tile * TILE;
                by_color[c][r][..columns].copy_from_slice(&by_pixel[start..start + columns]);
                let start = (r * (C + 1) + c) * width + tile * TILE;
                for (i, v) in image[start..start + columns].iter().enumerate() {
                    behind[r][i] = behind[r][i] + *v * by_color[c][r][i];
                }
            }
        }
        let mut live = (1u32 << height) - 1;
        for (n, &entry) in view.band.tile(tile).iter().enumerate() {
            if n % LOOK_EVERY == LOOK_EVERY - 1 {
                live = live_rows(&transmittance, height);
                if live == 0 {
                    break;
                }
            }
            let (stamp, rank) = Stamp::new(view, entry, tile, height);
            let feature = view.features[rank];
            // Moments of v = alpha * (derivative by alpha) in dy, and of the weights times the derivatives by color.
            let mut moments = [[T::zero(); TILE]; 3];
            let mut by_feature = [[T::zero(); TILE]; C];
            for r in stamp.rows.clone() {
                if live >> r & 1 == 0 {
                    continue;
                }
                let dy = stamp.dy0 + T::of(r as f64);
                let Some(alpha) = stamp.alpha::<FMA>(dy) else { continue };
                let r = r & (TILE - 1);
                let mut along = [T::zero(); TILE];
                for c in 0..C {
                    for i in 0..TILE {
                        along[i] = by_color[c][r][i].madd::<FMA>(feature[c], along[i]);
                    }
                }
                let mut weight = [T::zero(); TILE];
                for i in 0..TILE {
                    let t = transmittance[r][i];
                    let open = if t >= saturated { t } else { T::zero() };
                    let a = alpha[i].min(alpha_max);
                    weight[i] = open * a;
                    transmittance[r][i] = t - weight[i];
                    behind[r][i] = behind[r][i] - weight[i] * along[i];
                    let by_alpha = open * along[i] - behind[r][i] / (one - a);
                    // At the upper limit alpha no longer follows the splat; a saturated pixel sees nothing.
                    let follows = alpha[i] <= alpha_max && t >= saturated;
                    let v = if follows { by_alpha * alpha[i] } else { T::zero() };
                    moments[0][i] = moments[0][i] + v;
                    moments[1][i] = v.madd::<FMA>(dy, moments[1][i]);
                    moments[2][i] = v.madd::<FMA>(dy * dy, moments[2][i]);
                }
                for c in 0..C {
                    for i in 0..TILE {
                        by_feature[c][i] = weight[i].madd::<FMA>(by_color[c][r][i], by_feature[c][i]);
                    }
                }
            }
            let f = &view.chunks[entry.chunk as usize].footprints[entry.footprint as usize];
            slots[entry.slot as usize] = slot(f.conic, &stamp.dx, &moments, &by_feature);
        }
    }
}

/// Sums the lanes: derivatives by the ellipse's centre and conic from moments of `v` in (dx, dy).
#[inline(always)]
fn slot<T: Real, const C: usize>(
    [a, b, c]: [T; 3],
    dx: &Lane<T>,
    moments: &[Lane<T>; 3],
    by_feature: &[Lane<T>; C],
) -> SlotGradient<T, C> {
    let mut first = [T::zero(); TILE];
    let mut second = first;
    let mut mixed = first;
    for i in 0..TILE {
        first[i] = dx[i] * moments[0][i];
        second[i] = dx[i] * first[i];
        mixed[i] = dx[i] * moments[1][i];
    }
    let (sx, sy) = (lane_sum(&first), lane_sum(&moments[1]));
    let half = T::of(0.5);
    let mut feature = [T::zero(); C];
    for k in 0..C {
        feature[k] = lane_sum(&by_feature[k]);
    }
    SlotGradient {
        alpha: lane_sum(&moments[0]),
        mean: [a * sx + b * sy, b * sx + c * sy],
        conic: [-half * lane_sum(&second), -lane_sum(&mixed), -half * lane_sum(&moments[2])],
        feature,
    }
}

/// Sum by halves: vectorises, and the order is fixed.
#[inline(always)]
fn lane_sum<T: Real>(v: &Lane<T>) -> T {
    let mut s = *v;
    let mut n = TILE / 2;
    while n > 0 {
        for i in 0..n {
            s[i] = s[i] + s[i + n];
        }
        n /= 2;
    }
    s[0]
}
