//! Cast shadows by shadow mapping (EOGS): each pixel's share of sunlight from the altitudes in the view's and the sun's
//! renders, and its gradient.
//!
//! A pixel of the view is warped by its altitude z to the sun's render. With z' the altitude there, the share of sunlight is
//! `exp(ρ min(z - z', 0))`: 1 in full sun, falling towards 0 the higher the surface above the pixel is. BAEOGS (§3.2) prints
//! the opposite sign, which would darken what stands above its surroundings.

use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, Scaled, channel, stripe_rows};
use crate::splat::shear_warp::{GradientWindow, ShearWarp, sum_windows};
use rayon::prelude::*;

/// The constant ρ, per metre of altitude difference (EOGS).
pub(super) const SHADOW_RATE_PER_M: f64 = 0.4;

/// The sun's render of altitudes, and the map from a view's pixels to it.
pub type SunImage<'a, T> = (ShearWarp<T>, &'a Image<T>);

/// Computes the share of sunlight of a view's pixels; keeps its buffers between calls.
#[derive(Default)]
pub struct ShadowModel<T> {
    sunlight: Image<T>,
    by_sun: Image<T>,
    /// Derivatives by the sun's render that the pixels of each stripe contribute.
    stripes: Vec<GradientWindow<T, 1>>,
}

impl<T: SimdReal> ShadowModel<T> {
    /// Computes the share of sunlight, 0 to 1, of every pixel of a view's render; it is 1 without a sun.
    pub fn forward(&mut self, view: &Image<T>, sun: Option<SunImage<T>>) {
        let Image { width, height, .. } = *view;
        self.sunlight.resize(width, height, 1);
        let Some(sun) = sun else {
            self.sunlight.data.fill(T::one());
            return;
        };
        let rows = stripe_rows(height);
        self.sunlight.data.par_chunks_mut(rows * width).enumerate().for_each(|(k, sunlight)| {
            T::dispatch(Forward { view, sun, first_row: k * rows, sunlight });
        });
    }

    /// Computes the derivatives by the view's altitudes, which are written to `by_view`, and by the sun's render
    /// ([`ShadowModel::by_sun`]), from the sum of the derivatives `by_sunlight`.
    pub fn backward(
        &mut self,
        view: &Image<T>,
        sun: Option<SunImage<T>>,
        by_sunlight: &[Option<Scaled<T>>],
        by_view: &mut Image<T>,
    ) {
        let Image { width, height, .. } = *view;
        let channels = by_view.channels;
        let Some(sun) = sun else {
            for row in by_view.data.chunks_mut(channels * width) {
                row[channel::ALTITUDE * width..][..width].fill(T::zero());
            }
            return;
        };
        let rows = stripe_rows(height);
        self.stripes.resize_with(height.div_ceil(rows), GradientWindow::default);
        let sunlight = &self.sunlight;
        let outputs = by_view.data.par_chunks_mut(rows * channels * width).zip(&mut self.stripes);
        outputs.enumerate().for_each(|(k, (by_view, by_sun))| {
            let first_row = k * rows;
            T::dispatch(Backward { view, sun, sunlight, by_sunlight, first_row, channels, by_view, by_sun });
        });
        self.by_sun.resize(sun.1.width, sun.1.height, 1);
        let stripes = &self.stripes;
        sum_windows(&mut self.by_sun, T::one(), |k| stripes.get(k));
    }

    /// The share of sunlight of the last forward pass, one channel.
    #[must_use]
    pub fn sunlight(&self) -> &Image<T> {
        &self.sunlight
    }

    /// Derivatives by the altitudes in the sun's render, per metre, as the last backward pass computed them.
    #[must_use]
    pub fn by_sun(&self) -> &Image<T> {
        &self.by_sun
    }
}

/// The share of sunlight of a stripe.
struct Forward<'a, T> {
    view: &'a Image<T>,
    sun: SunImage<'a, T>,
    first_row: usize,
    sunlight: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { view, sun: (warp, image), first_row, sunlight } = self;
        let width = view.width;
        let [zero, rate] = broadcast_each(simd, [T::zero(), T::from_f64(SHADOW_RATE_PER_M)]);
        for (k, sunlight) in sunlight.chunks_mut(width).enumerate() {
            let row = first_row + k;
            for start in (0..width).step_by(S::WIDTH) {
                let z = SimdVec::load_from(simd, view.row(channel::ALTITUDE, row), start);
                let warped = warp.warp(simd, start..width, row, z, image);
                let (higher, _) = warped.sample(simd, image, 0);
                let s = (rate * (z - higher).select_or_zero(warped.inside).min(zero)).exp();
                s.store_to(sunlight, start);
            }
        }
    }
}

/// The derivatives of a stripe.
struct Backward<'a, T> {
    view: &'a Image<T>,
    sun: SunImage<'a, T>,
    sunlight: &'a Image<T>,
    by_sunlight: &'a [Option<Scaled<'a, T>>],
    first_row: usize,
    channels: usize,
    by_view: &'a mut [T],
    by_sun: &'a mut GradientWindow<T, 1>,
}

impl<T: SimdReal> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { view, sun: (warp, image), sunlight, by_sunlight, first_row, channels, by_view, by_sun } =
            self;
        let width = view.width;
        let rows = first_row..first_row + by_view.len() / (channels * width);
        let altitudes = rows.clone().flat_map(|r| view.row(channel::ALTITUDE, r));
        by_sun.reset(image.width, warp.target_rows(rows, altitudes, image.height));
        let [zero, one, rate] = broadcast_each(simd, [T::zero(), T::one(), T::from_f64(SHADOW_RATE_PER_M)]);
        for (k, by_view) in by_view.chunks_mut(channels * width).enumerate() {
            let row = first_row + k;
            let by_altitude = &mut by_view[channel::ALTITUDE * width..][..width];
            for start in (0..width).step_by(S::WIDTH) {
                let s = SimdVec::load_from(simd, sunlight.row(0, row), start);
                let mut by_s = zero;
                for part in by_sunlight.iter().flatten() {
                    by_s = part.add_to(simd, by_s, 0, row, start);
                }
                let z = SimdVec::load_from(simd, view.row(channel::ALTITUDE, row), start);
                let warped = warp.warp(simd, start..width, row, z, image);
                let (higher, slopes) = warped.sample(simd, image, 0);
                let shaded = higher.greater_than(z).and(warped.inside);
                let by_delta = (rate * s * by_s).select_or_zero(shaded);
                warped.scatter(simd, shaded, [zero - by_delta], by_sun);
                (by_delta * (one - warp.altitude_derivative(simd, slopes))).store_to(by_altitude, start);
            }
        }
    }
}
