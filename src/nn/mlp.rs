//! A multilayer perceptron: fully connected layers with ReLU between them, and its gradient.
//!
//! A part of the inputs can be the same for all items, such as the embedding of a view. Its products with the first layer's
//! weights are computed once, as a part of the bias.

use super::linear::{Activation, BLOCK, add_weight_gradient, mask_by_relu, multiply};
use crate::random::CounterRng;
use crate::simd::{Real, Simd};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// The shape of a network.
///
/// Its parameters are one vector: of each layer the weights, with a row for each output, and the biases. In the rows of the
/// first layer the weights of the shared inputs follow those of the others.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Mlp {
    /// Number of inputs that differ between items.
    pub inputs: usize,
    /// Number of inputs that all items share.
    pub shared: usize,
    /// Number of outputs of each hidden layer.
    pub hidden: Vec<usize>,
    /// Number of outputs.
    pub outputs: usize,
}

/// A layer: its size, and where its values are among the parameters.
struct Layer {
    inputs: usize,
    outputs: usize,
    /// Index of the first weight.
    first: usize,
}

impl Layer {
    fn weights(&self, stride: usize) -> Range<usize> {
        self.first..self.first + self.outputs * stride
    }

    fn biases(&self, stride: usize) -> Range<usize> {
        let end = self.weights(stride).end;
        end..end + self.outputs
    }
}

impl Mlp {
    /// The layers among parameters in which the first layer has so many shared inputs.
    fn layers(&self, shared: usize) -> Vec<Layer> {
        let mut layers = Vec::new();
        let (mut inputs, mut first) = (self.inputs, 0);
        for (k, outputs) in self.hidden.iter().chain([&self.outputs]).enumerate() {
            layers.push(Layer { inputs, outputs: *outputs, first });
            let stride = inputs + if k == 0 { shared } else { 0 };
            (inputs, first) = (*outputs, first + outputs * (stride + 1));
        }
        layers
    }

    /// Number of parameters.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.count(self.shared)
    }

    fn count(&self, shared: usize) -> usize {
        let last = self.layers(shared).pop();
        last.map_or(0, |l| l.biases(l.inputs + if self.hidden.is_empty() { shared } else { 0 }).end)
    }

    /// Initial parameters: the weights of hidden layers uniform with the variance of He et al. 2015, those of the last layer
    /// and all biases zero, so that the outputs are zero whatever the inputs are.
    #[must_use]
    pub fn start<T: Real>(&self, seed: u64, purpose: u64) -> Vec<T> {
        let mut values = vec![T::zero(); self.parameters()];
        let layers = self.layers(self.shared);
        for (k, layer) in layers[..layers.len() - 1].iter().enumerate() {
            let stride = layer.inputs + if k == 0 { self.shared } else { 0 };
            fill_uniform(&mut values[layer.weights(stride)], stride, seed, purpose, k);
        }
        values
    }

    /// As [`Mlp::start`], with random weights in the last layer too.
    #[must_use]
    pub fn start_all<T: Real>(&self, seed: u64, purpose: u64) -> Vec<T> {
        let mut values = self.start(seed, purpose);
        let layers = self.layers(self.shared);
        let last = &layers[layers.len() - 1];
        let stride = last.inputs + if self.hidden.is_empty() { self.shared } else { 0 };
        fill_uniform(&mut values[last.weights(stride)], stride, seed, purpose, layers.len() - 1);
        values
    }

    /// The network with these parameters and shared inputs.
    #[must_use]
    pub fn with<T: Real>(&self, values: &[T], shared: &[T]) -> SharedMlp<T> {
        let mut own = SharedMlp {
            layers: self.layers(0),
            values: vec![T::zero(); self.count(0)],
            transposed: Vec::new(),
        };
        for (k, (to, from)) in own.layers.iter().zip(self.layers(self.shared)).enumerate() {
            let stride = from.inputs + if k == 0 { self.shared } else { 0 };
            let rows = values[from.weights(stride)].chunks_exact(stride);
            let biases = &values[from.biases(stride)];
            for (row, (weights, bias)) in rows.zip(biases).enumerate() {
                let (weights, of_shared) = weights.split_at(from.inputs);
                own.values[to.first + row * to.inputs..][..to.inputs].copy_from_slice(weights);
                let products = of_shared.iter().zip(shared).map(|(w, x)| *w * *x);
                own.values[to.biases(to.inputs).start + row] = products.fold(*bias, |sum, p| sum + p);
            }
        }
        own.transpose();
        own
    }

    /// Adds the derivatives by the parameters and by the shared inputs to `by_values` and `by_shared`, from those by the
    /// parameters of the network that [`Mlp::with`] returned.
    pub fn add_gradient<T: Real>(
        &self,
        by_own: &[T],
        values: &[T],
        shared: &[T],
        by_values: &mut [T],
        by_shared: &mut [T],
    ) {
        for (k, (own, to)) in self.layers(0).iter().zip(self.layers(self.shared)).enumerate() {
            let stride = to.inputs + if k == 0 { self.shared } else { 0 };
            let by_biases = &by_own[own.biases(own.inputs)];
            let by_weights = by_own[own.weights(own.inputs)].chunks_exact(own.inputs);
            for (row, (by_weights, by_bias)) in by_weights.zip(by_biases).enumerate() {
                let line = to.first + row * stride..to.first + (row + 1) * stride;
                let (of_own, of_shared) = by_values[line.clone()].split_at_mut(to.inputs);
                of_own.iter_mut().zip(by_weights).for_each(|(sum, by)| *sum = *sum + *by);
                of_shared.iter_mut().zip(shared).for_each(|(sum, x)| *sum = *sum + *by_bias * *x);
                let weights = &values[line][to.inputs..];
                by_shared.iter_mut().zip(weights).for_each(|(sum, w)| *sum = *sum + *by_bias * *w);
                let bias = &mut by_values[to.biases(stride).start + row];
                *bias = *bias + *by_bias;
            }
        }
    }
}

/// Draws the weights of a layer with so many inputs: uniform, with the variance of He et al. 2015.
fn fill_uniform<T: Real>(weights: &mut [T], inputs: usize, seed: u64, purpose: u64, layer: usize) {
    let bound = (6.0 / inputs as f64).sqrt();
    let mut draw = CounterRng::new(seed, purpose, layer as u64, 0);
    weights.iter_mut().for_each(|value| *value = T::from_f64(bound * (2.0 * draw.uniform() - 1.0)));
}

/// A network whose shared inputs are a part of its biases.
pub struct SharedMlp<T> {
    layers: Vec<Layer>,
    /// Of each layer the weights and the biases.
    values: Vec<T>,
    /// The weights with rows and columns exchanged, at the same places.
    transposed: Vec<T>,
}

impl<T: Real> SharedMlp<T> {
    fn transpose(&mut self) {
        self.transposed = self.values.clone();
        for layer in &self.layers {
            for row in 0..layer.outputs {
                for col in 0..layer.inputs {
                    self.transposed[layer.first + col * layer.outputs + row] =
                        self.values[layer.first + row * layer.inputs + col];
                }
            }
        }
    }

    /// The rows of a block's inputs that the network has.
    fn own<'a>(&self, inputs: &'a [T]) -> &'a [T] {
        &inputs[..self.layers[0].inputs * BLOCK]
    }

    /// Number of parameters, without those of shared inputs.
    #[must_use]
    pub fn parameters(&self) -> usize {
        self.values.len()
    }
}

/// The values of a block of items in a network's layers; keeps its buffers between blocks.
#[derive(Default)]
pub struct MlpBlock<T> {
    /// Outputs of each layer.
    outputs: Vec<Vec<T>>,
    /// Derivatives by the inputs and by the outputs of the layer that is being processed.
    by: [Vec<T>; 2],
}

impl<T: Real> MlpBlock<T> {
    /// The outputs of a block of [`BLOCK`] items, from its inputs; both feature by feature. Further rows of inputs are ignored.
    #[inline(always)]
    pub fn forward<S: Simd<Scalar = T>>(&mut self, simd: S, network: &SharedMlp<T>, inputs: &[T]) -> &[T] {
        self.outputs.resize_with(network.layers.len(), Vec::new);
        let last = network.layers.len() - 1;
        for (k, layer) in network.layers.iter().enumerate() {
            let (before, own) = self.outputs.split_at_mut(k);
            own[0].resize(layer.outputs * BLOCK, T::zero());
            let activation = if k == last { Activation::Identity } else { Activation::Relu };
            let x = before.last().map_or(network.own(inputs), |x| &x[..]);
            let weights = &network.values[layer.weights(layer.inputs)];
            multiply(simd, weights, &network.values[layer.biases(layer.inputs)], x, activation, &mut own[0]);
        }
        &self.outputs[last]
    }

    /// The derivatives by the inputs of the block of the last forward pass, from those by its outputs. Adds those by the
    /// parameters to `by_values`.
    #[inline(always)]
    pub fn backward<S: Simd<Scalar = T>>(
        &mut self,
        simd: S,
        network: &SharedMlp<T>,
        inputs: &[T],
        by_outputs: &[T],
        by_values: &mut [T],
    ) -> &[T] {
        let [by_x, by_y] = &mut self.by;
        by_y.clear();
        by_y.extend_from_slice(by_outputs);
        for (k, layer) in network.layers.iter().enumerate().rev() {
            let x = if k == 0 { network.own(inputs) } else { &self.outputs[k - 1] };
            let (weights, biases) = (layer.weights(layer.inputs), layer.biases(layer.inputs));
            let (by_weights, by_biases) =
                by_values[weights.start..biases.end].split_at_mut(layer.outputs * layer.inputs);
            add_weight_gradient(simd, by_y, x, by_weights, by_biases);
            by_x.resize(layer.inputs * BLOCK, T::zero());
            multiply(simd, &network.transposed[weights], &[], by_y, Activation::Identity, by_x);
            if k > 0 {
                mask_by_relu(simd, x, by_x);
            }
            std::mem::swap(by_x, by_y);
        }
        by_y
    }
}

#[cfg(test)]
#[path = "mlp_tests.rs"]
mod tests;
