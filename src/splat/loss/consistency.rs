//! Consistency with a randomly sheared view (EOGS's `L_new_altitude` and `L_new_rgb`).
//!
//! The virtual view is a render with the view's camera and a random shear. Where both renders show the same surface, their
//! altitudes and colours must agree.

use super::term::{ByView, LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec, broadcast_each};
use crate::splat::raster::{Image, Scaled, channel, stripe_rows};
use crate::splat::shear_warp::{GradientWindow, ShearWarp, sum_windows};
use rayon::prelude::*;

/// The weights are per metre of altitude and per unit of linear colour; the columns are the mean absolute differences.
pub const INFO: TermInfo = TermInfo {
    weights: &["consistency_altitude", "consistency_color"],
    columns: &["consistency_altitude_m", "consistency_color"],
    scope: TermScope::Any,
};
/// Two pixels show the same surface if their altitudes differ by less than this, metres (EOGS).
pub const SAME_SURFACE_M: f64 = 0.30;

/// The term; keeps its buffers between calls.
#[derive(Default)]
pub struct Consistency<T> {
    by_view: Image<T>,
    by_virtual: Image<T>,
    /// One over the number of compared pixels.
    pixel_weight: T,
    /// Whether the last iteration had a virtual view.
    is_evaluated: bool,
    stripes: Vec<Stripe<T>>,
}

/// Results of the comparison over a stripe.
#[derive(Default)]
struct Stripe<T> {
    by_virtual: GradientWindow<T, 4>,
    sums: Sums,
}

/// Number of pixels that show the same surface in the virtual view, and sums over them.
#[derive(Clone, Copy, Default)]
struct Sums {
    pixels: f64,
    altitude: f64,
    color: f64,
}

/// Weights of the mean absolute differences.
#[derive(Clone, Copy, Debug)]
struct Weights {
    /// Per metre of altitude.
    altitude: f64,
    /// Per unit of linear colour.
    color: f64,
}

/// Mean absolute differences over the pixels that show the same surface.
#[derive(Clone, Copy, Debug, Default)]
struct Difference {
    /// Of the altitudes, metres.
    altitude: f64,
    /// Of the linear colours, summed over the three channels.
    color: f64,
}

impl<T: SimdReal> Consistency<T> {
    /// Compares colours and altitudes of a view with those of a virtual view, to which `warp` maps the view's pixels, and
    /// computes the derivatives of the weighted sum of the differences.
    fn compare(
        &mut self,
        view: &Image<T>,
        virtual_view: &Image<T>,
        warp: &ShearWarp<T>,
        weights: Weights,
    ) -> Difference {
        let Image { width, height, .. } = *view;
        let rows = stripe_rows(height);
        self.by_view.resize(width, height, 4);
        self.by_virtual.resize(virtual_view.width, virtual_view.height, 4);
        self.stripes.resize_with(height.div_ceil(rows), Stripe::default);
        let by_view = self.by_view.data.par_chunks_mut(rows * 4 * width);
        by_view.zip(&mut self.stripes).enumerate().for_each(|(k, (by_view, stripe))| {
            let first_row = k * rows;
            T::dispatch(Compare { view, virtual_view, warp, weights, first_row, by_view, stripe });
        });
        let sum = |of: fn(&Sums) -> f64| self.stripes.iter().map(|s| of(&s.sums)).sum::<f64>();
        let pixels = sum(|s| s.pixels).max(1.0);
        self.pixel_weight = T::from_f64(1.0 / pixels);
        let stripes = &self.stripes;
        sum_windows(&mut self.by_virtual, self.pixel_weight, |k| stripes.get(k).map(|s| &s.by_virtual));
        Difference { altitude: sum(|s| s.altitude) / pixels, color: sum(|s| s.color) / pixels }
    }
}

impl<T: SimdReal> Consistency<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

impl<T: SimdReal> LossTerm<T> for Consistency<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        self.is_evaluated = rendered.virtual_view.is_some();
        let Some((virtual_view, warp)) = rendered.virtual_view else { return 0.0 };
        let weights = Weights { altitude: weights[0], color: weights[1] };
        let Difference { altitude, color } = self.compare(rendered.view, virtual_view, warp, weights);
        columns.copy_from_slice(&[altitude, color]);
        weights.altitude * altitude + weights.color * color
    }

    fn by_view(&self) -> Option<ByView<'_, T>> {
        let scaled = Scaled { image: &self.by_view, factor: self.pixel_weight };
        self.is_evaluated.then_some(ByView { scaled, channels: &[0, 1, 2, channel::ALTITUDE] })
    }

    fn by_virtual_view(&self) -> Option<&Image<T>> {
        self.is_evaluated.then_some(&self.by_virtual)
    }
}

/// The comparison over a stripe. The derivatives are those of the sum over the pixels, still to be divided by their
/// number.
struct Compare<'a, T> {
    view: &'a Image<T>,
    virtual_view: &'a Image<T>,
    warp: &'a ShearWarp<T>,
    weights: Weights,
    first_row: usize,
    by_view: &'a mut [T],
    stripe: &'a mut Stripe<T>,
}

impl<T: SimdReal> SimdKernel<T> for Compare<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { view, virtual_view, warp, weights, first_row, by_view, stripe } = self;
        let width = view.width;
        let rows = first_row..first_row + by_view.len() / (4 * width);
        let altitudes = rows.clone().flat_map(|r| view.row(channel::ALTITUDE, r));
        stripe.by_virtual.reset(virtual_view.width, warp.target_rows(rows, altitudes, virtual_view.height));
        stripe.sums = Sums::default();
        let [zero, one, same_surface_m] = broadcast_each(simd, [0.0, 1.0, SAME_SURFACE_M].map(T::from_f64));
        let Weights { altitude, color } = weights;
        let weights = broadcast_each(simd, [color, color, color, altitude].map(T::from_f64));
        for (k, by_view) in by_view.chunks_mut(4 * width).enumerate() {
            let row = first_row + k;
            let (mut pixels, mut altitude, mut color) = (zero, zero, zero);
            for start in (0..width).step_by(S::WIDTH) {
                let z = SimdVec::load_from(simd, view.row(channel::ALTITUDE, row), start);
                let warped = warp.warp(simd, start..width, row, z, virtual_view);
                let (other_z, slopes) = warped.sample(simd, virtual_view, 3);
                let difference = z - other_z;
                let same = same_surface_m.greater_than(difference.abs()).and(warped.inside);
                let mut by = [zero; 4];
                let mut by_slopes = zero;
                if same.any() {
                    pixels += one.select_or_zero(same);
                    altitude += difference.abs().select_or_zero(same);
                    by[3] = difference.sign().select_or_zero(same) * weights[3];
                    by_slopes = by[3] * warp.altitude_derivative(simd, slopes);
                    for c in 0..3 {
                        let (other, slopes) = warped.sample(simd, virtual_view, c);
                        let difference =
                            (SimdVec::load_from(simd, view.row(c, row), start) - other).select_or_zero(same);
                        color += difference.abs();
                        by[c] = difference.sign() * weights[c];
                        by_slopes += by[c] * warp.altitude_derivative(simd, slopes);
                    }
                    let mut by_others = [zero; 4];
                    for c in 0..4 {
                        by_others[c] = zero - by[c];
                    }
                    warped.scatter(simd, same, by_others, &mut stripe.by_virtual);
                }
                by[3] = by[3] - by_slopes;
                for c in 0..4 {
                    by[c].store_to(&mut by_view[c * width..(c + 1) * width], start);
                }
            }
            stripe.sums.pixels += pixels.sum().as_f64();
            stripe.sums.altitude += altitude.sum().as_f64();
            stripe.sums.color += color.sum().as_f64();
        }
    }
}
