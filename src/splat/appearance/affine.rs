//! EOGS's colour model: each view has an affine map of colours and an ambient light colour.
//!
//! `pixel = (s + (1 - s) κ) ⊙ (W rgb + t)`, with `s` the share of sunlight in [0, 1]. The 3 x 3 matrix `W`, the vector `t` and
//! the ambient light `κ`, relative to sunlight, are parameters of the view.

use super::model::{AppearanceModel, ShadingGradient, ShadingInput};
use crate::simd::{Arithmetic, MAX_LANES, Real, Simd, SimdKernel, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, Scaled, stripe_rows};
use rayon::prelude::*;

/// Number of parameters of a view: `W` row by row, `t`, `κ`.
const PARAMETERS: usize = 15;

/// The model; keeps its buffers between calls.
#[derive(Default)]
pub struct AffineAppearance<T> {
    /// Sums of the derivatives by the parameters over each stripe.
    by_values: Vec<[T; PARAMETERS]>,
}

/// The parameters for colours and images whose linear values are `factor` times as large.
pub fn scale(values: &mut [f32], factor: f32) {
    values.iter_mut().skip(9).take(3).for_each(|t| *t *= factor);
}

impl<T: SimdReal> AppearanceModel<T> for AffineAppearance<T> {
    /// `W` is the identity, `t` is zero, and `κ` is 0.05 in each channel (EOGS).
    fn start_view(&self, _: u64, _: u64) -> Vec<T> {
        let (o, z, k) = (T::one(), T::zero(), T::from_f64(0.05));
        vec![o, z, z, z, o, z, z, z, o, z, z, z, k, k, k]
    }

    fn sunlit(&self, values: &[T], rgb: [T; 3]) -> [T; 3] {
        ColorMap::new(values).sunlit(rgb)
    }

    fn shade(&mut self, values: &[T], input: ShadingInput<T>, picture: &mut Image<T>) {
        let Image { width, height, .. } = *input.render;
        let map = ColorMap::new(values);
        picture.resize(width, height, 3);
        let rows = stripe_rows(height);
        picture.data.par_chunks_mut(rows * 3 * width).enumerate().for_each(|(k, picture)| {
            T::dispatch(Forward { map, input, first_row: k * rows, picture });
        });
    }

    fn shade_backward(
        &mut self,
        values: &[T],
        input: ShadingInput<T>,
        by_picture: &[Option<Scaled<T>>],
        gradient: ShadingGradient<T>,
    ) {
        let Image { width, height, channels, .. } = *input.render;
        let map = ColorMap::new(values);
        let rows = stripe_rows(height);
        let ShadingGradient { by_render, by_sunlight, by_values } = gradient;
        self.by_values.resize(height.div_ceil(rows), [T::zero(); PARAMETERS]);
        by_sunlight.resize(width, height, 1);
        let outputs = by_render.data.par_chunks_mut(rows * (channels - 1) * width);
        let outputs = outputs.zip(by_sunlight.data.par_chunks_mut(rows * width)).zip(&mut self.by_values);
        outputs.enumerate().for_each(|(k, ((by_render, by_sunlight), by_values))| {
            let first_row = k * rows;
            T::dispatch(Backward { map, input, by_picture, first_row, by_render, by_sunlight, by_values });
        });
        by_values.fill(T::zero());
        for part in &self.by_values {
            for (sum, by) in by_values.iter_mut().zip(part) {
                *sum = *sum + *by;
            }
        }
    }
}

/// A view's parameters: scalars, or vectors that hold the same parameter in all lanes.
#[derive(Clone, Copy)]
struct ColorMap<N> {
    values: [N; PARAMETERS],
}

impl<T: Real> ColorMap<T> {
    /// The parameters; missing ones are zero.
    fn new(values: &[T]) -> Self {
        let mut own = [T::zero(); PARAMETERS];
        own.iter_mut().zip(values).for_each(|(own, value)| *own = *value);
        Self { values: own }
    }

    #[inline(always)]
    fn broadcast<S: Simd<Scalar = T>>(self, simd: S) -> ColorMap<SimdVec<S>> {
        ColorMap { values: broadcast_each(simd, self.values) }
    }
}

impl<N: Arithmetic> ColorMap<N> {
    /// `W rgb + t`.
    #[inline(always)]
    fn sunlit(&self, rgb: [N; 3]) -> [N; 3] {
        let v = &self.values;
        let mut out = rgb;
        for i in 0..3 {
            out[i] = v[3 * i] * rgb[0] + v[3 * i + 1] * rgb[1] + v[3 * i + 2] * rgb[2] + v[9 + i];
        }
        out
    }

    /// The light relative to full sunlight at the share of sunlight `s`: `s + (1 - s) κ`.
    #[inline(always)]
    fn light(&self, s: N) -> [N; 3] {
        let mut out = [s; 3];
        for i in 0..3 {
            out[i] = s + self.values[12 + i] - s * self.values[12 + i];
        }
        out
    }

    /// Returns the derivatives by `rgb` and by `s`, from those by the pixel; adds those by the parameters to `by_values`.
    #[inline(always)]
    fn backward(&self, rgb: [N; 3], s: N, by_pixel: [N; 3], by_values: &mut [N; PARAMETERS]) -> ([N; 3], N) {
        let (sunlit, light) = (self.sunlit(rgb), self.light(s));
        let v = &self.values;
        let (mut by_sunlit, mut by_share) = (by_pixel, by_pixel);
        for i in 0..3 {
            by_sunlit[i] = by_pixel[i] * light[i];
            let by_light = by_pixel[i] * sunlit[i];
            by_share[i] = by_light - by_light * v[12 + i];
            by_values[12 + i] = by_values[12 + i] + by_light - by_light * s;
            by_values[9 + i] = by_values[9 + i] + by_sunlit[i];
            for k in 0..3 {
                by_values[3 * i + k] = by_values[3 * i + k] + by_sunlit[i] * rgb[k];
            }
        }
        let mut by_rgb = rgb;
        for k in 0..3 {
            by_rgb[k] = by_sunlit[0] * v[k] + by_sunlit[1] * v[3 + k] + by_sunlit[2] * v[6 + k];
        }
        (by_rgb, by_share[0] + by_share[1] + by_share[2])
    }
}

/// One in the lanes of valid pixels, else zero.
#[inline(always)]
fn validity<S: Simd>(simd: S, valid: &[bool], start: usize) -> SimdVec<S> {
    let (zero, one) = (S::Scalar::from_f64(0.0), S::Scalar::from_f64(1.0));
    if valid.is_empty() {
        return SimdVec::broadcast(simd, one);
    }
    let mut out = [zero; MAX_LANES];
    for (o, v) in out.iter_mut().zip(&valid[start..]) {
        *o = if *v { one } else { zero };
    }
    SimdVec::load(simd, &out)
}

/// The picture of a stripe.
struct Forward<'a, T> {
    map: ColorMap<T>,
    input: ShadingInput<'a, T>,
    first_row: usize,
    picture: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let ShadingInput { render, sunlight, valid } = self.input;
        let (width, map) = (render.width, self.map.broadcast(simd));
        let zero = SimdVec::broadcast(simd, T::zero());
        for (k, picture) in self.picture.chunks_mut(3 * width).enumerate() {
            let row = self.first_row + k;
            for start in (0..width).step_by(S::WIDTH) {
                let s = SimdVec::load_from(simd, sunlight.row(0, row), start);
                let mut rgb = [zero; 3];
                for c in 0..3 {
                    rgb[c] = SimdVec::load_from(simd, render.row(c, row), start);
                }
                let (sunlit, light) = (map.sunlit(rgb), map.light(s));
                let validity = validity(simd, valid, row * width + start);
                for c in 0..3 {
                    (validity * sunlit[c] * light[c])
                        .store_to(&mut picture[c * width..(c + 1) * width], start);
                }
            }
        }
    }
}

/// The derivatives of a stripe.
struct Backward<'a, T> {
    map: ColorMap<T>,
    input: ShadingInput<'a, T>,
    by_picture: &'a [Option<Scaled<'a, T>>],
    first_row: usize,
    /// Derivatives by all channels of the render except the last, the transmittance.
    by_render: &'a mut [T],
    by_sunlight: &'a mut [T],
    by_values: &'a mut [T; PARAMETERS],
}

impl<T: SimdReal> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let ShadingInput { render, sunlight, valid } = self.input;
        let (width, map) = (render.width, self.map.broadcast(simd));
        let zero = SimdVec::broadcast(simd, T::zero());
        let mut by_values = [zero; PARAMETERS];
        let by_rows = self.by_render.chunks_mut((render.channels - 1) * width);
        for (k, (by_render, by_sunlight)) in by_rows.zip(self.by_sunlight.chunks_mut(width)).enumerate() {
            let row = self.first_row + k;
            for start in (0..width).step_by(S::WIDTH) {
                let validity = validity(simd, valid, row * width + start);
                let (mut rgb, mut by_pixel) = ([zero; 3], [zero; 3]);
                for part in self.by_picture.iter().flatten() {
                    for c in 0..3 {
                        by_pixel[c] = part.add_to(simd, by_pixel[c], c, row, start);
                    }
                }
                for c in 0..3 {
                    rgb[c] = SimdVec::load_from(simd, render.row(c, row), start);
                    by_pixel[c] = validity * by_pixel[c];
                }
                let s = SimdVec::load_from(simd, sunlight.row(0, row), start);
                let (by_rgb, by_s) = map.backward(rgb, s, by_pixel, &mut by_values);
                for c in 0..3 {
                    by_rgb[c].store_to(&mut by_render[c * width..(c + 1) * width], start);
                }
                by_s.store_to(by_sunlight, start);
            }
        }
        *self.by_values = by_values.map(SimdVec::sum);
    }
}
