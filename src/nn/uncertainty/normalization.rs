//! Normalisation of the channels of features over the patches of an image (Ioffe & Szegedy 2015).

use crate::simd::Real;
use std::slice::ChunksExact;

/// Added to variances (PyTorch's `BatchNorm2d`).
const VARIANCE_FLOOR: f64 = 1e-5;

/// Mean and variance of each channel.
pub(super) struct Statistics<T> {
    pub mean: Vec<T>,
    pub variance: Vec<T>,
}

impl<T: Real> Statistics<T> {
    /// Those over the patches of an image, at least one.
    pub(super) fn of(vectors: ChunksExact<'_, f32>, channels: usize) -> Self {
        let per_patch = T::from_f64(1.0 / vectors.len() as f64);
        let mut mean = vec![T::zero(); channels];
        for vector in vectors.clone() {
            for (sum, value) in mean.iter_mut().zip(vector) {
                *sum = *sum + real::<T>(*value);
            }
        }
        mean.iter_mut().for_each(|sum| *sum = *sum * per_patch);
        let mut variance = vec![T::zero(); channels];
        for vector in vectors {
            for ((sum, value), mean) in variance.iter_mut().zip(vector).zip(&mean) {
                let difference = real::<T>(*value) - *mean;
                *sum = *sum + difference * difference;
            }
        }
        variance.iter_mut().for_each(|sum| *sum = *sum * per_patch);
        Self { mean, variance }
    }

    /// The normalisation to mean 0 and variance 1, times a factor for each channel.
    pub(super) fn normalization(self, factors: &[T]) -> Normalization<T> {
        let factor =
            |(variance, factor): (&T, &T)| *factor / (*variance + T::from_f64(VARIANCE_FLOOR)).sqrt();
        Normalization { factors: self.variance.iter().zip(factors).map(factor).collect(), mean: self.mean }
    }
}

/// `(x - mean) factor` of each channel.
pub(super) struct Normalization<T> {
    mean: Vec<T>,
    factors: Vec<T>,
}

impl<T: Real> Normalization<T> {
    /// Mean and factor of each channel.
    pub(super) fn each(&self) -> impl Iterator<Item = (T, T)> + '_ {
        self.mean.iter().copied().zip(self.factors.iter().copied())
    }
}

/// A linear function of a feature vector.
pub(super) struct Linear<T> {
    pub weights: Vec<T>,
    pub bias: T,
}

impl<T: Real> Linear<T> {
    pub(super) fn of(&self, vector: &[f32]) -> T {
        self.weights
            .iter()
            .zip(vector)
            .fold(self.bias, |sum, (weight, value)| sum + *weight * real::<T>(*value))
    }
}

/// A value of a feature as a number of another type, without loss.
#[inline(always)]
pub(super) fn real<T: Real>(value: f32) -> T {
    T::from_f64(f64::from(value))
}
