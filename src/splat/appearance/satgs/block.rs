//! Colours of a block of splats and their gradient (SatGS, equations 6 to 8).
//!
//! `t = γ c + β`, `k = s + (1 - s) a`, colour `= k t`: γ and β from the tone network, `s` from the shadow network. The hidden
//! layers are computed again in the backward pass, which is faster than storing them for all splats.

use crate::nn::linear::BLOCK;
use crate::nn::mlp::{MlpBlock, SharedMlp};
use crate::simd::{Real, Simd, SimdKernel};
use crate::splat::appearance::light::SplatLight;

/// The networks of a view, with embedding and sun as parts of their biases.
pub(super) struct ViewNetworks<T> {
    pub tone: SharedMlp<T>,
    /// None if the sun is unknown: all splats are lit.
    pub shadow: Option<SharedMlp<T>>,
    pub ambient: [T; 3],
}

/// Values of the colours of a block.
const COLORS: usize = 3 * BLOCK;

/// Buffers of a block.
#[derive(Default)]
pub(super) struct BlockBuffers<T> {
    /// Splat colours, position features and visibility of the sun: the first rows are the inputs of the tone network, the
    /// last ones those of the shadow network.
    inputs: Vec<T>,
    tone: MlpBlock<T>,
    shadow: MlpBlock<T>,
    by_tone: Vec<T>,
    by_logit: Vec<T>,
}

/// A block's splats: their position features, colours, and visibility of the sun.
#[derive(Clone, Copy)]
pub(super) struct BlockInput<'a, T> {
    pub networks: &'a ViewNetworks<T>,
    pub features: &'a [T],
    pub colors: &'a [[T; 3]],
    /// Empty if the sun is unknown.
    pub visible: &'a [T],
}

/// Computes toned colours and shares of sunlight.
pub(super) struct Forward<'a, T> {
    pub input: BlockInput<'a, T>,
    pub buffers: &'a mut BlockBuffers<T>,
    pub toned: &'a mut [[T; 3]],
    pub sunlit: &'a mut [T],
}

/// Factor and offset of a colour channel of an item from the tone network's outputs.
#[inline(always)]
fn tone_of<T: Real>(outputs: &[T], item: usize, channel: usize) -> (T, T) {
    (T::one() + outputs[channel * BLOCK + item], outputs[(3 + channel) * BLOCK + item])
}

/// `1 / (1 + exp(-x))`.
#[inline(always)]
pub(super) fn logistic<T: Real>(x: T) -> T {
    (T::one() + (-x).exp()).recip()
}

impl<T: Real> BlockBuffers<T> {
    /// Fills the inputs.
    #[inline(always)]
    fn fill(&mut self, input: &BlockInput<T>) {
        self.inputs.clear();
        self.inputs.resize(COLORS, T::zero());
        for (c, row) in self.inputs.chunks_mut(BLOCK).enumerate() {
            row.iter_mut().zip(input.colors).for_each(|(value, color)| *value = color[c]);
        }
        self.inputs.extend_from_slice(input.features);
        self.inputs.extend_from_slice(input.visible);
        self.inputs.resize(COLORS + input.features.len() + BLOCK, T::zero());
    }
}

impl<T: Real> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { input, buffers, toned, sunlit } = self;
        buffers.fill(&input);
        let outputs = buffers.tone.forward(simd, &input.networks.tone, &buffers.inputs);
        for (i, (toned, color)) in toned.iter_mut().zip(input.colors).enumerate() {
            for c in 0..3 {
                let (factor, offset) = tone_of(outputs, i, c);
                toned[c] = factor * color[c] + offset;
            }
        }
        match &input.networks.shadow {
            None => sunlit.fill(T::one()),
            Some(shadow) => {
                let logits = buffers.shadow.forward(simd, shadow, &buffers.inputs[COLORS..]);
                sunlit.iter_mut().zip(logits).for_each(|(s, logit)| *s = logistic(*logit));
            }
        }
    }
}

/// Computes the derivatives from those by colours, and by toned colours and shares of sunlight.
pub(super) struct Backward<'a, T> {
    pub input: BlockInput<'a, T>,
    pub buffers: &'a mut BlockBuffers<T>,
    pub toned: &'a [[T; 3]],
    pub sunlit: &'a [T],
    pub by_colors: &'a [[T; 3]],
    pub by_light: Option<&'a SplatLight<T>>,
    /// Index of the block's first splat in `by_light`.
    pub first: usize,
    pub by_features: &'a mut [T],
    pub by_splat_colors: &'a mut [[T; 3]],
    /// Derivatives by the parameters of tone and shadow network, and by the ambient light, to add to.
    pub sums: &'a mut GradientSums<T>,
}

/// Sums over blocks of the derivatives by the networks' parameters.
#[derive(Clone, Default)]
pub(super) struct GradientSums<T> {
    pub tone: Vec<T>,
    pub shadow: Vec<T>,
    pub ambient: [T; 3],
}

impl<T: Real> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(mut self, simd: S) {
        self.buffers.fill(&self.input);
        self.by_outputs(simd);
        let Self { input, buffers, by_features, sums, .. } = self;
        let BlockBuffers { inputs, tone, shadow, by_tone, by_logit } = buffers;
        let by = tone.backward(simd, &input.networks.tone, inputs, by_tone, &mut sums.tone);
        by_features.fill(T::zero());
        by_features.iter_mut().zip(&by[COLORS..]).for_each(|(sum, by)| *sum = *by);
        if let Some(network) = &input.networks.shadow {
            let inputs = &inputs[COLORS..];
            shadow.forward(simd, network, inputs);
            let by = shadow.backward(simd, network, inputs, by_logit, &mut sums.shadow);
            by_features.iter_mut().zip(by).for_each(|(sum, by)| *sum = *sum + *by);
        }
    }
}

impl<T: Real> Backward<'_, T> {
    /// The derivatives by the outputs of both networks, by the splats' colours and by the ambient light.
    #[inline(always)]
    fn by_outputs<S: Simd<Scalar = T>>(&mut self, simd: S) {
        let Self { input, buffers, .. } = self;
        let ambient = input.networks.ambient;
        let has_sun = input.networks.shadow.is_some();
        let outputs = buffers.tone.forward(simd, &input.networks.tone, &buffers.inputs);
        buffers.by_tone.resize(6 * BLOCK, T::zero());
        buffers.by_logit.resize(BLOCK, T::zero());
        buffers.by_tone.fill(T::zero());
        buffers.by_logit.fill(T::zero());
        for (i, by_color) in self.by_colors.iter().enumerate() {
            let (toned, s) = (self.toned[i], self.sunlit[i]);
            let shade = T::one() - s;
            let mut by_s = self.by_light.map_or(T::zero(), |l| l.sunlit[self.first + i]);
            for c in 0..3 {
                let own = self.by_light.map_or(T::zero(), |l| l.toned[self.first + i][c]);
                let by_toned = by_color[c] * (s + shade * ambient[c]) + own;
                let by_light = by_color[c] * toned[c];
                by_s = by_s + by_light * (T::one() - ambient[c]);
                self.sums.ambient[c] = self.sums.ambient[c] + by_light * shade;
                let (factor, _) = tone_of(outputs, i, c);
                buffers.by_tone[c * BLOCK + i] = by_toned * input.colors[i][c];
                buffers.by_tone[(3 + c) * BLOCK + i] = by_toned;
                self.by_splat_colors[i][c] = by_toned * factor;
            }
            if has_sun {
                buffers.by_logit[i] = by_s * s * shade;
            }
        }
    }
}
