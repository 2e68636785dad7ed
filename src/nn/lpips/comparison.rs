//! The distance of two images in one layer, and its gradient.
//!
//! With the features `f` and `g` of a pixel, `u = f / (|f| + ε)` and `v = g / (|g| + ε)`, the distance of the layer is the
//! mean over pixels of `Σ w (u - v)²` over channels (Zhang et al. 2018, equation 1; here `w` are the squares of the paper's).

use crate::nn::feature_map::{FeatureMap, LANES, Pixel16, Stripe};
use crate::simd::{Real, Simd, SimdKernel, SimdReal, SimdVec};
use rayon::prelude::*;

/// `ε` of the normalisation in LPIPS 0.1.
const EPSILON: f64 = 1e-10;

/// The weight of each channel of a layer.
pub(super) struct Comparison<T> {
    weights: Vec<Pixel16<T>>,
}

/// What the gradient needs of one pixel.
#[derive(Clone, Copy, Default)]
struct PixelTerms<T> {
    /// `1 / (|f| + ε)` and `1 / (|g| + ε)`.
    inverse_norms: [T; 2],
    /// `Σ w (u - v) f / (|f| (|f| + ε)²)`: how much of the derivative is in the direction of `f`.
    radial: T,
}

/// The distance of one pair of layers, and what its gradient needs of each pixel.
pub(super) struct Compared<T> {
    /// The mean over pixels.
    pub(super) distance: f64,
    /// Row by row.
    terms: Vec<PixelTerms<T>>,
}

impl<T: SimdReal> Comparison<T> {
    /// A comparison with a weight for each channel.
    pub(super) fn new(weights: &[T]) -> Self {
        let mut blocks = vec![[T::zero(); LANES]; weights.len().div_ceil(LANES)];
        blocks.as_flattened_mut()[..weights.len()].copy_from_slice(weights);
        Self { weights: blocks }
    }

    /// The distance of two images by their features.
    pub(super) fn compare(&self, picture: &FeatureMap<T>, target: &FeatureMap<T>) -> Compared<T> {
        let (width, height) = (picture.width(), picture.height());
        let mut terms = vec![PixelTerms::default(); width * height];
        let mut sums = vec![0.0; height];
        let rows = terms.par_chunks_exact_mut(width).zip(&mut sums).enumerate();
        rows.for_each(|(row, (terms, sum))| {
            T::dispatch(RowKernel { weights: &self.weights, picture, target, row, terms, sum });
        });
        Compared { distance: sums.iter().sum::<f64>() / (width * height) as f64, terms }
    }

    /// Adds the derivatives of the distance by the features of the picture; those by features of zero are meaningless, as a
    /// ReLU, which all features come from, has no gradient there.
    pub(super) fn add_gradient(
        &self,
        picture: &FeatureMap<T>,
        target: &FeatureMap<T>,
        compared: &Compared<T>,
        by_picture: &mut FeatureMap<T>,
    ) {
        let scale = T::from_f64(2.0 / (picture.width() * picture.height()) as f64);
        by_picture.stripes_mut().into_par_iter().for_each(|by_picture| {
            let weights = &self.weights[by_picture.block];
            T::dispatch(GradientKernel {
                weights,
                picture,
                target,
                terms: &compared.terms,
                scale,
                by_picture,
            });
        });
    }
}

/// The terms of the pixels of a row, and the sum of their distances.
struct RowKernel<'a, T> {
    weights: &'a [Pixel16<T>],
    picture: &'a FeatureMap<T>,
    target: &'a FeatureMap<T>,
    row: usize,
    terms: &'a mut [PixelTerms<T>],
    sum: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for RowKernel<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(mut self, simd: S) {
        for col in 0..self.terms.len() {
            self.compare_pixel(simd, col);
        }
    }
}

impl<T: Real> RowKernel<'_, T> {
    #[inline(always)]
    fn compare_pixel<S: Simd<Scalar = T>>(&mut self, simd: S, col: usize) {
        let zero = SimdVec::broadcast(simd, T::zero());
        let mut squares = [zero; 2];
        for block in 0..self.weights.len() {
            let (f, g) = (&self.picture.row(block, self.row)[col], &self.target.row(block, self.row)[col]);
            for lane in (0..LANES).step_by(S::WIDTH) {
                let (f, g) = (SimdVec::load(simd, &f[lane..]), SimdVec::load(simd, &g[lane..]));
                squares = [f.mul_add(f, squares[0]), g.mul_add(g, squares[1])];
            }
        }
        let norms = [squares[0].sum().sqrt(), squares[1].sum().sqrt()];
        let inverse_norms = norms.map(|norm| (norm + T::from_f64(EPSILON)).recip());
        let [by_f, by_g] = inverse_norms.map(|inverse| SimdVec::broadcast(simd, inverse));
        let (mut distance, mut radial) = (zero, zero);
        for (block, weights) in self.weights.iter().enumerate() {
            let (f, g) = (&self.picture.row(block, self.row)[col], &self.target.row(block, self.row)[col]);
            for lane in (0..LANES).step_by(S::WIDTH) {
                let (f, g) = (SimdVec::load(simd, &f[lane..]), SimdVec::load(simd, &g[lane..]));
                let difference = f * by_f - g * by_g;
                let weighted = SimdVec::load(simd, &weights[lane..]) * difference;
                distance = weighted.mul_add(difference, distance);
                radial = weighted.mul_add(f, radial);
            }
        }
        *self.sum += distance.sum().as_f64();
        let radial = if norms[0] > T::zero() {
            radial.sum() * inverse_norms[0] * inverse_norms[0] / norms[0]
        } else {
            T::zero()
        };
        self.terms[col] = PixelTerms { inverse_norms, radial };
    }
}

/// The derivatives by a stripe of the picture's features.
struct GradientKernel<'a, T> {
    weights: &'a Pixel16<T>,
    picture: &'a FeatureMap<T>,
    target: &'a FeatureMap<T>,
    terms: &'a [PixelTerms<T>],
    scale: T,
    by_picture: Stripe<'a, T>,
}

impl<T: SimdReal> SimdKernel<T> for GradientKernel<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Stripe { block, first_row, rows } = self.by_picture;
        let scale = SimdVec::broadcast(simd, self.scale);
        for (row, by_row) in (first_row..).zip(rows) {
            let terms = &self.terms[row * by_row.len()..];
            let pixels = self.picture.row(block, row).iter().zip(self.target.row(block, row));
            for ((by_pixel, (f, g)), terms) in by_row.iter_mut().zip(pixels).zip(terms) {
                let [by_f, by_g] = terms.inverse_norms.map(|inverse| SimdVec::broadcast(simd, inverse));
                let radial = SimdVec::broadcast(simd, terms.radial);
                for lane in (0..LANES).step_by(S::WIDTH) {
                    let (f, g) = (SimdVec::load(simd, &f[lane..]), SimdVec::load(simd, &g[lane..]));
                    let weights = SimdVec::load(simd, &self.weights[lane..]);
                    let by_feature = weights * (f * by_f - g * by_g) * by_f - f * radial;
                    let sum = by_feature.mul_add(scale, SimdVec::load(simd, &by_pixel[lane..]));
                    sum.store_to(by_pixel, lane);
                }
            }
        }
    }
}
