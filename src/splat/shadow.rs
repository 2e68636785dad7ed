//! Cast shadows: from the altitudes that the view and the sun see to each pixel's share of sunlight, and back (EOGS).
//!
//! From each pixel's altitude the sun's altitude image is looked up: where it lies `Δ` metres higher, the share of
//! sunlight is `exp(ρ min(-Δ, 0))`.

use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec, broadcast_each};
use crate::splat::loss::Scaled;
use crate::splat::raster::{Image, channel, stripe_rows};
use crate::splat::shear_warp::{GradientWindow, ShearWarp, sum_windows};
use rayon::prelude::*;

/// Extinction of sunlight per metre that the sun sees something higher (EOGS: fixed).
const SHADOW_RATE_PER_M: f64 = 0.4;

/// The sun's image of altitudes, and where a view's pixels lie in it.
pub type SunImage<'a, T> = (ShearWarp<T>, &'a Image<T>);

/// Computes shares of sunlight; keeps its buffers.
#[derive(Default)]
pub struct ShadowModel<T> {
    sunlight: Image<T>,
    by_sun: Image<T>,
    /// What each run of rows scatters.
    stripes: Vec<GradientWindow<T, 1>>,
}

impl<T: SimdReal> ShadowModel<T> {
    /// The share of sunlight of every pixel of a view's render, one channel; 1 without a sun.
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

    /// From derivatives by the share of sunlight, the sum of all parts, to those by the view's altitudes, which are written,
    /// and by the sun's image, which [`ShadowModel::by_sun`] gives.
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

    /// Derivatives by the altitudes in the sun's image.
    #[must_use]
    pub fn by_sun(&self) -> &Image<T> {
        &self.by_sun
    }
}

/// The shares of a run of rows.
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
                let places = warp.places(simd, start..width, row, z, image);
                let (higher, _) = places.values(simd, image, 0);
                let s = (rate * (z - higher).select_or_zero(places.inside).min(zero)).exp();
                s.store_to(sunlight, start);
            }
        }
    }
}

/// The derivatives of a run of rows.
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
        by_sun.open(image.width, warp.rows(rows, altitudes, image.height));
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
                let places = warp.places(simd, start..width, row, z, image);
                let (higher, slopes) = places.values(simd, image, 0);
                let shaded = higher.greater_than(z).and(places.inside);
                let by_delta = (rate * s * by_s).select_or_zero(shaded);
                places.scatter(simd, shaded, [zero - by_delta], by_sun);
                (by_delta * (one - warp.by_altitude(simd, slopes))).store_to(by_altitude, start);
            }
        }
    }
}
