//! The uncertainty of patches as a function of their features: dropout, batch normalisation, one linear output, softplus.

use super::normalization::{Linear, Normalization, Statistics, real};
use super::{UncertaintyError, UncertaintyLoss};
use crate::io::Grid2;
use crate::nn::features::FeatureMap;
use crate::random::CounterRng;
use crate::simd::Real;
use serde::{Deserialize, Serialize};
use std::slice::ChunksExact;

/// Share of the channels that an iteration leaves out (WildGaussians).
const DROPOUT: f64 = 0.5;
/// Standard deviation of the weights at the start (WildGaussians).
const WEIGHT_DEVIATION: f64 = 0.01;
/// Smallest uncertainty (WildGaussians).
const LEAST_SIGMA: f64 = 0.1;
/// Share of an image in the running statistics (PyTorch's `BatchNorm2d`).
const MOMENTUM: f64 = 0.1;
/// Purposes of random numbers.
const DRAW_WEIGHT: u64 = 30;
const DRAW_DROPOUT: u64 = 31;

/// All that training has made of a head.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeadState<T> {
    /// Length of a feature vector.
    pub channels: usize,
    /// Scale, shift and weight of each channel, group by group, then the bias: `3 channels + 1` values.
    pub parameters: Vec<T>,
    /// Mean of each channel over the last images, not trained.
    pub running_mean: Vec<T>,
    /// Variance of each channel over the last images, not trained.
    pub running_variance: Vec<T>,
}

/// The head of WildGaussians (Kulhanek et al. 2024): channels are dropped in training, normalised over the patches of an image
/// (Ioffe & Szegedy 2015), and combined linearly; σ = max(softplus(output + log(e - 1)), 0.1), which is 1 at an output of 0.
///
/// One departure: a channel is dropped after it is normalised, where WildGaussians drops it before. Normalising removes the scale,
/// so that training is the same; but the running statistics are those of features, not of a mixture with zeros, and evaluation
/// uses the expected value of a normalised channel.
///
/// Gradients end at the features.
#[derive(Clone, Debug)]
pub struct UncertaintyHead<T> {
    state: HeadState<T>,
    gradient: Vec<T>,
}

impl<T: Real> UncertaintyHead<T> {
    /// A head for features of so many channels, whose uncertainty is about 1 everywhere.
    #[must_use]
    pub fn new(channels: usize, seed: u64) -> Self {
        let weight =
            |k| T::from_f64(WEIGHT_DEVIATION * CounterRng::new(seed, DRAW_WEIGHT, 0, k as u64).normal());
        let scales = std::iter::repeat_n(T::one(), channels);
        let shifts = std::iter::repeat_n(T::zero(), channels);
        let parameters: Vec<T> =
            scales.chain(shifts).chain((0..channels).map(weight)).chain([T::zero()]).collect();
        let (running_mean, running_variance) = (vec![T::zero(); channels], vec![T::one(); channels]);
        let gradient = vec![T::zero(); parameters.len()];
        Self { state: HeadState { channels, parameters, running_mean, running_variance }, gradient }
    }

    /// The head that continues from a state.
    ///
    /// # Errors
    /// [`UncertaintyError::State`] if a part of the state has not the expected number of finite values.
    pub fn from_state(state: HeadState<T>) -> Result<Self, UncertaintyError> {
        let channels = state.channels;
        let parameters = channels.saturating_mul(3).saturating_add(1);
        for (field, values, expected) in [
            ("parameters", &state.parameters, parameters),
            ("running_mean", &state.running_mean, channels),
            ("running_variance", &state.running_variance, channels),
        ] {
            let found = values.iter().filter(|v| v.is_finite()).count();
            if found != expected || values.len() != expected {
                return Err(UncertaintyError::State { channels, field, found, expected });
            }
        }
        let gradient = vec![T::zero(); parameters];
        Ok(Self { state, gradient })
    }

    /// The state from which training can continue.
    #[must_use]
    pub fn state(&self) -> &HeadState<T> {
        &self.state
    }

    /// The parameters, for an optimiser to change; in the order of [`HeadState::parameters`].
    pub fn parameters_mut(&mut self) -> &mut [T] {
        &mut self.state.parameters
    }

    /// The derivative of the last [`UncertaintyHead::train`]'s loss by each parameter.
    #[must_use]
    pub fn gradient(&self) -> &[T] {
        &self.gradient
    }

    /// [`UncertaintyHead::parameters_mut`] and [`UncertaintyHead::gradient`] at once, for an optimiser's step.
    pub fn parameters_and_gradient(&mut self) -> (&mut [T], &[T]) {
        (&mut self.state.parameters, &self.gradient)
    }

    /// The mean loss over the patches of an image, with its gradient; also updates the running statistics.
    ///
    /// Which channels are dropped depends on seed and iteration only.
    ///
    /// # Errors
    /// [`UncertaintyError`] if the features are not of the head's channels, or the dissimilarities not of the features' patches.
    pub fn train(
        &mut self,
        features: &FeatureMap,
        dissimilarity: &Grid2,
        loss: &UncertaintyLoss,
        seed: u64,
        iteration: u64,
    ) -> Result<f64, UncertaintyError> {
        let vectors = self.vectors(features)?;
        let patches = vectors.len();
        if dissimilarity.data.len() != patches || patches == 0 {
            return Err(UncertaintyError::Patches { found: dissimilarity.data.len(), expected: patches });
        }
        let channels = self.state.channels;
        let statistics = Statistics::of(vectors.clone(), channels);
        self.update_running(&statistics, patches);
        let kept = |k: usize| CounterRng::new(seed, DRAW_DROPOUT, iteration, k as u64).uniform() >= DROPOUT;
        let factors: Vec<T> = (0..channels).map(|k| if kept(k) { T::one() } else { T::zero() }).collect();
        let sums = self.sums(vectors, dissimilarity, loss, &statistics.normalization(&factors));
        self.write_gradient(&sums);
        Ok(sums.loss)
    }

    /// The uncertainty of each patch of an image, at least 0.1, with all channels and the running statistics.
    ///
    /// # Errors
    /// [`UncertaintyError::Channels`] if the features are not of the head's channels.
    pub fn sigma(&self, features: &FeatureMap) -> Result<Grid2, UncertaintyError> {
        let vectors = self.vectors(features)?;
        let HeadState { running_mean, running_variance, channels, .. } = &self.state;
        let statistics = Statistics { mean: running_mean.clone(), variance: running_variance.clone() };
        let output = self.output(&statistics.normalization(&vec![T::from_f64(1.0 - DROPOUT); *channels]));
        let data = vectors.map(|vector| sigma(output.of(vector)).0.as_f64() as f32).collect();
        Ok(Grid2 { width: features.width, height: features.height, data })
    }

    /// The vectors of features that are of the head's channels.
    fn vectors<'a>(&self, features: &'a FeatureMap) -> Result<ChunksExact<'a, f32>, UncertaintyError> {
        let (found, expected) = (features.channels, self.state.channels);
        if found != expected || found == 0 {
            return Err(UncertaintyError::Channels { found, expected });
        }
        Ok(features.data.chunks_exact(found))
    }

    fn update_running(&mut self, statistics: &Statistics<T>, patches: usize) {
        let momentum = T::from_f64(MOMENTUM);
        // PyTorch's running variance is the unbiased one.
        let unbiased = T::from_f64(patches as f64 / (patches as f64 - 1.0).max(1.0));
        let blend = |running: &mut [T], present: &[T], scale: T| {
            for (r, p) in running.iter_mut().zip(present) {
                *r = *r + momentum * (*p * scale - *r);
            }
        };
        blend(&mut self.state.running_mean, &statistics.mean, T::one());
        blend(&mut self.state.running_variance, &statistics.variance, unbiased);
    }

    /// Scales, shifts and weights of the channels, and the bias.
    fn split(&self) -> (&[T], &[T], &[T], T) {
        let channels = self.state.channels;
        let (scales, rest) = self.state.parameters.split_at(channels);
        let (shifts, rest) = rest.split_at(channels);
        (scales, shifts, &rest[..channels], rest[channels])
    }

    /// The linear function of features that normalisation, scales, shifts and weights make together.
    fn output(&self, normalization: &Normalization<T>) -> Linear<T> {
        let (scales, shifts, weights, bias) = self.split();
        let mut linear = Linear { weights: Vec::with_capacity(weights.len()), bias };
        for (k, (mean, factor)) in normalization.each().enumerate() {
            let weight = weights[k] * scales[k] * factor;
            linear.bias = linear.bias + weights[k] * shifts[k] - weight * mean;
            linear.weights.push(weight);
        }
        linear
    }

    /// The mean loss over patches, and what its gradient is made of.
    fn sums(
        &self,
        vectors: ChunksExact<'_, f32>,
        dissimilarity: &Grid2,
        loss: &UncertaintyLoss,
        normalization: &Normalization<T>,
    ) -> Sums<T> {
        let output = self.output(normalization);
        let share = 1.0 / vectors.len() as f64;
        let by_normalized = vec![T::zero(); self.state.channels];
        let mut sums = Sums { loss: 0.0, by_output: T::zero(), by_normalized };
        for (vector, d) in vectors.zip(&dissimilarity.data) {
            let (sigma, slope) = sigma(output.of(vector));
            let (value, by_sigma) = loss.with_gradient(real(*d), sigma);
            let by_output = by_sigma * slope * T::from_f64(share);
            sums.loss += share * value.as_f64();
            sums.by_output = sums.by_output + by_output;
            let channels = sums.by_normalized.iter_mut().zip(vector).zip(normalization.each());
            for ((sum, value), (mean, factor)) in channels {
                *sum = *sum + by_output * (real::<T>(*value) - mean) * factor;
            }
        }
        sums
    }

    fn write_gradient(&mut self, sums: &Sums<T>) {
        let channels = self.state.channels;
        let mut gradient = std::mem::take(&mut self.gradient);
        let (scales, shifts, weights, _) = self.split();
        for (k, by_normalized) in sums.by_normalized.iter().enumerate() {
            gradient[k] = weights[k] * *by_normalized;
            gradient[channels + k] = weights[k] * sums.by_output;
            gradient[2 * channels + k] = scales[k] * *by_normalized + shifts[k] * sums.by_output;
        }
        gradient[3 * channels] = sums.by_output;
        self.gradient = gradient;
    }
}

/// Sums over the patches of an image.
struct Sums<T> {
    /// The mean loss.
    loss: f64,
    /// Its derivative by an output that all patches share.
    by_output: T,
    /// Its derivative by a factor of each normalised channel in the output.
    by_normalized: Vec<T>,
}

/// The uncertainty of an output of the linear function, and its derivative by the output.
fn sigma<T: Real>(output: T) -> (T, T) {
    let (zero, one) = (T::zero(), T::one());
    let x = output + T::from_f64(std::f64::consts::E - 1.0).ln();
    // log(1 + e^x), written such that e^x cannot overflow.
    let small = (-x.abs()).exp();
    let softplus = x.max(zero) + small.ln_1p();
    let slope = if x > zero { one / (one + small) } else { small / (one + small) };
    let least = T::from_f64(LEAST_SIGMA);
    if softplus > least { (softplus, slope) } else { (least, zero) }
}
