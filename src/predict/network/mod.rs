//! The network: from groups of points and their key points to the numbers of each splat (Point2GS §3.2).
//!
//! 1. `encoder`: a PointNet encodes the group of points around each key point (equation 3).
//! 2. The features of a key point are its group's, and numbers that are known of it: its surroundings, and what the images
//!    show there (equation 4).
//! 3. `attention`: each query takes a weighted mean of the features of the key points around it (equation 5).
//! 4. A perceptron makes [`OUTPUTS`] numbers of the mean and of what is known of the query (equation 6).
//!
//! Everything is generic over the number type: training runs in f32, tests compare gradients with differences in f64. There is
//! no normalisation of layers: batches are single tiles, and inputs are of the order of one.

mod attention;
mod blocks;
mod encoder;
pub(crate) mod graph;
mod input;
#[cfg(test)]
mod tests;

pub use blocks::FeatureBlocks;
pub use encoder::{GROUP, MEMBER_INPUTS};
pub use input::{NEIGHBOURS, NetworkInput};

use crate::nn::mlp::{Mlp, MlpBlock, SharedMlp};
use crate::simd::{Real, Simd, SimdKernel, SimdReal};
use attention::{Attention, AttentionState, CODES, HEADS};
use blocks::sum_stripes;
use encoder::Encoder;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Numbers that the network gives for a splat: offset (3), size (3), orientation (4), opacity, colour (3).
pub const OUTPUTS: usize = 14;
/// What is known of a key point beside its group; [`input`](super::input) has the list.
pub const KEY_INPUTS: usize = 5;
/// What is known of a query; [`input`](super::input) has the list.
pub const QUERY_INPUTS: usize = 16;
/// Largest number of image features of a key point: the largest networks give vectors of some thousand numbers.
pub const MOST_IMAGE_FEATURES: usize = 8192;
/// Purposes of the random numbers.
const DRAW_MEMBERS: u64 = 40;
const DRAW_GROUPS: u64 = 41;
const DRAW_KEYS: u64 = 42;
const DRAW_HEAD: u64 = 43;

/// The shape of the network. Its parameters are one vector, in the order of the fields; the last are a distance decay for each
/// head of the attention.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplatNetwork {
    /// Width of the encoder's layers, of the values of the attention, and of the hidden layers of the last perceptron.
    pub width: usize,
    /// Number of image features of a key point.
    pub image_features: usize,
}

impl Default for SplatNetwork {
    fn default() -> Self {
        Self { width: 64, image_features: super::image_features::FEATURES }
    }
}

/// The parts of the network, and where their values are among its parameters.
struct Parts {
    encoder: Encoder,
    of_encoder: Range<usize>,
    keys: Mlp,
    of_keys: Range<usize>,
    head: Mlp,
    of_head: Range<usize>,
    of_decays: Range<usize>,
}

impl SplatNetwork {
    fn parts(&self) -> Parts {
        let width = self.width;
        let encoder = Encoder { width };
        let keys = Mlp {
            inputs: width + KEY_INPUTS + self.image_features,
            shared: 0,
            hidden: Vec::new(),
            outputs: CODES + width,
        };
        let head =
            Mlp { inputs: width + QUERY_INPUTS, shared: 0, hidden: vec![width, width], outputs: OUTPUTS };
        let mut first = 0;
        let mut next = |n: usize| {
            first += n;
            first - n..first
        };
        let of_encoder = next(encoder.parameters());
        let of_keys = next(keys.parameters());
        let of_head = next(head.parameters());
        Parts { encoder, of_encoder, keys, of_keys, head, of_head, of_decays: next(HEADS) }
    }

    /// Whether the attention can divide the width among its heads, and nothing is too large to be meant.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        (1..=512).contains(&self.width)
            && self.width.is_multiple_of(HEADS)
            && self.image_features <= MOST_IMAGE_FEATURES
    }

    /// Number of parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.parts().of_decays.end
    }

    /// Initial parameters. The outputs are zero whatever the inputs are.
    #[must_use]
    pub fn start<T: Real>(&self, seed: u64) -> Vec<T> {
        let parts = self.parts();
        let mut values = parts.encoder.start(seed, [DRAW_MEMBERS, DRAW_GROUPS]);
        values.extend(parts.keys.start_all::<T>(seed, DRAW_KEYS));
        values.extend(parts.head.start::<T>(seed, DRAW_HEAD));
        values.resize(parts.of_decays.end, T::zero());
        values
    }
}

/// Evaluates a network and its gradient; keeps what the gradient needs of the last evaluation.
pub struct NetworkEvaluation<T> {
    parts: Parts,
    encoder: encoder::EncoderState<T>,
    /// Inputs of the layer of the key points: features of the groups, and what is known beside them.
    key_inputs: FeatureBlocks<T>,
    keys: Vec<MlpBlock<T>>,
    attention: AttentionState<T>,
    /// Inputs of the last perceptron: features that attention gives, and what is known of the queries.
    head_inputs: FeatureBlocks<T>,
    head: Vec<MlpBlock<T>>,
    outputs: FeatureBlocks<T>,
}

impl<T: SimdReal> NetworkEvaluation<T> {
    /// An evaluation of a network of this shape.
    #[must_use]
    pub fn new(network: &SplatNetwork) -> Self {
        Self {
            parts: network.parts(),
            encoder: encoder::EncoderState::default(),
            key_inputs: FeatureBlocks::default(),
            keys: Vec::new(),
            attention: AttentionState::default(),
            head_inputs: FeatureBlocks::default(),
            head: Vec::new(),
            outputs: FeatureBlocks::default(),
        }
    }

    /// The outputs of the queries, [`OUTPUTS`] each.
    pub fn forward(&mut self, values: &[T], input: &NetworkInput<T>) -> &FeatureBlocks<T> {
        let Parts { encoder, of_encoder, keys, of_keys, head, of_head, of_decays } = &self.parts;
        let width = encoder.width;
        let keys_known = input.keys.features();
        self.key_inputs.resize(width + keys_known, input.keys.items());
        self.encoder.forward(encoder, &values[of_encoder.clone()], &input.members, &mut self.key_inputs);
        self.key_inputs.copy_rows(width, &input.keys);
        let network = keys.with(&values[of_keys.clone()], &[]);
        let mut of_keys = FeatureBlocks::default();
        forward_all(&network, &mut self.keys, &self.key_inputs, CODES + width, &mut of_keys);
        self.head_inputs.resize(width + QUERY_INPUTS, input.queries.items());
        let attention = Attention { width, decays: &values[of_decays.clone()], input };
        self.attention.forward(attention, &of_keys, &mut self.head_inputs);
        self.head_inputs.copy_rows(width, &input.queries);
        let network = head.with(&values[of_head.clone()], &[]);
        forward_all(&network, &mut self.head, &self.head_inputs, OUTPUTS, &mut self.outputs);
        &self.outputs
    }

    /// Adds the derivatives by the parameters that follow from those by the last outputs.
    pub fn backward(
        &mut self,
        values: &[T],
        input: &NetworkInput<T>,
        by_outputs: &FeatureBlocks<T>,
        by_values: &mut [T],
    ) {
        let Parts { encoder, of_encoder, keys, of_keys, head, of_head, of_decays } = &self.parts;
        let width = encoder.width;
        let network = head.with(&values[of_head.clone()], &[]);
        let by = &mut by_values[of_head.clone()];
        let by_inputs = backward_all(&network, &mut self.head, &self.head_inputs, by_outputs, by);
        let attention = Attention { width, decays: &values[of_decays.clone()], input };
        let by_keys = self.attention.backward(attention, &by_inputs, &mut by_values[of_decays.clone()]);
        let network = keys.with(&values[of_keys.clone()], &[]);
        let by = &mut by_values[of_keys.clone()];
        let by_inputs = backward_all(&network, &mut self.keys, &self.key_inputs, &by_keys, by);
        let values = &values[of_encoder.clone()];
        self.encoder.backward(
            encoder,
            values,
            &input.members,
            &by_inputs,
            &mut by_values[of_encoder.clone()],
        );
    }
}

/// Evaluates a perceptron for all items.
fn forward_all<T: SimdReal>(
    network: &SharedMlp<T>,
    states: &mut Vec<MlpBlock<T>>,
    inputs: &FeatureBlocks<T>,
    outputs: usize,
    out: &mut FeatureBlocks<T>,
) {
    out.resize(outputs, inputs.items());
    states.resize_with(inputs.count(), MlpBlock::default);
    let blocks = states.par_iter_mut().zip(inputs.par_blocks()).zip(out.par_blocks_mut());
    blocks.for_each(|((state, inputs), out)| T::dispatch(Forward { network, state, inputs, out }));
}

/// The derivatives by all items' inputs; adds those by the parameters to `by_values`.
fn backward_all<T: SimdReal>(
    network: &SharedMlp<T>,
    states: &mut [MlpBlock<T>],
    inputs: &FeatureBlocks<T>,
    by_outputs: &FeatureBlocks<T>,
    by_values: &mut [T],
) -> FeatureBlocks<T> {
    let mut by_inputs = FeatureBlocks::default();
    by_inputs.resize(inputs.features(), inputs.items());
    let items = states.par_iter_mut().zip(inputs.par_blocks());
    let items = items.zip(by_outputs.par_blocks()).zip(by_inputs.par_blocks_mut());
    sum_stripes(items, by_values, |(((state, inputs), by_outputs), by_inputs), by_values| {
        T::dispatch(Backward { network, state, inputs, by_outputs, by_inputs, by_values });
    });
    by_inputs
}

/// Outputs of a perceptron for a block.
struct Forward<'a, T> {
    network: &'a SharedMlp<T>,
    state: &'a mut MlpBlock<T>,
    inputs: &'a [T],
    out: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Forward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        self.out.copy_from_slice(self.state.forward(simd, self.network, self.inputs));
    }
}

/// Derivatives of a perceptron for a block.
struct Backward<'a, T> {
    network: &'a SharedMlp<T>,
    state: &'a mut MlpBlock<T>,
    inputs: &'a [T],
    by_outputs: &'a [T],
    by_inputs: &'a mut [T],
    by_values: &'a mut [T],
}

impl<T: SimdReal> SimdKernel<T> for Backward<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let by = self.state.backward(simd, self.network, self.inputs, self.by_outputs, self.by_values);
        self.by_inputs.copy_from_slice(by);
    }
}
