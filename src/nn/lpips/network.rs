//! A network whose layers are compared: features of images, and the gradient back to the pixels.

use super::architecture::{Architecture, ConvolutionLayer, LayerKind};
use super::comparison::Comparison;
use super::image::PlanarRgb;
use super::input::InputCells;
use crate::nn::convolution::{Convolution, KernelShape};
use crate::nn::feature_map::FeatureMap;
use crate::nn::max_pool::MaxPool;
use crate::simd::SimdReal;

/// The layers with their weights.
pub(super) struct Network<T> {
    cells: InputCells,
    layers: Vec<Layer<T>>,
}

/// A layer with its weights.
enum Layer<T> {
    /// A convolution with its ReLU, and the comparison of its output if it is compared.
    Convolution(Convolution<T>, Option<Comparison<T>>),
    /// Maxima over windows.
    Pool(MaxPool),
}

/// Features of the picture and the target before the first layer and after each, and derivatives by them.
#[derive(Default)]
pub(super) struct Buffers<T> {
    /// First the picture's.
    features: [Vec<FeatureMap<T>>; 2],
    by_output: FeatureMap<T>,
    by_input: FeatureMap<T>,
}

impl<T: SimdReal> Network<T> {
    /// A network with the weights that `tensor` returns for a name and a shape, with as many values as the shape has.
    pub(super) fn new<E>(
        architecture: &Architecture,
        mut tensor: impl FnMut(&str, &[usize]) -> Result<Vec<T>, E>,
    ) -> Result<Self, E> {
        let cells = InputCells::new(architecture);
        let mut comparisons = 0;
        let mut tensors = |layer: &ConvolutionLayer, inputs: usize| {
            let ConvolutionLayer { index, channels, side, .. } = *layer;
            let weights = tensor(&format!("features.{index}.weight"), &[channels, inputs, side, side])?;
            let bias = tensor(&format!("features.{index}.bias"), &[channels])?;
            let mut comparison = None;
            if layer.compared {
                let weights = tensor(&format!("lin{comparisons}.model.1.weight"), &[1, channels, 1, 1])?;
                comparison = Some(Comparison::new(&weights));
                comparisons += 1;
            }
            Ok((weights, bias, comparison))
        };
        let (weights, bias, comparison) = tensors(&architecture.first, 3)?;
        let mut layers = vec![Layer::Convolution(cells.convolution(&weights, &bias), comparison)];
        let mut inputs = architecture.first.channels;
        for kind in architecture.others {
            layers.push(match kind {
                LayerKind::Pool(pool) => Layer::Pool(*pool),
                LayerKind::Convolution(layer) => {
                    let (weights, bias, comparison) = tensors(layer, inputs)?;
                    let convolution = convolution(layer, inputs, &weights, &bias);
                    inputs = layer.channels;
                    Layer::Convolution(convolution, comparison)
                }
            });
        }
        Ok(Self { cells, layers })
    }

    /// The distance of two images of equal size. Features of a layer are dropped when those of the next are known.
    pub(super) fn distance(&self, images: [PlanarRgb<'_, T>; 2]) -> f64 {
        let mut features = images.map(|image| {
            let mut cells = FeatureMap::default();
            self.cells.cut(image, &mut cells);
            cells
        });
        let mut distance = 0.0;
        for layer in &self.layers {
            features = features.map(|input| {
                let mut output = FeatureMap::default();
                layer.forward(&input, &mut output);
                output
            });
            if let Some(comparison) = layer.comparison() {
                distance += comparison.compare(&features[0], &features[1]).distance;
            }
        }
        distance
    }

    /// The distance of two images of equal size; sets its derivatives by the values of the picture, channel after channel.
    pub(super) fn distance_with_gradient(
        &self,
        picture: PlanarRgb<'_, T>,
        target: PlanarRgb<'_, T>,
        buffers: &mut Buffers<T>,
        by_picture: &mut Vec<T>,
    ) -> f64 {
        let Buffers { features, by_output, by_input } = buffers;
        for (features, image) in features.iter_mut().zip([picture, target]) {
            features.resize_with(self.layers.len() + 1, FeatureMap::default);
            self.features(image, features);
        }
        let [picture_features, target_features] = features;
        let last = &picture_features[self.layers.len()];
        by_output.clear(last.width(), last.height(), last.channels());
        let mut distances = Vec::new();
        for (k, layer) in self.layers.iter().enumerate().rev() {
            let (input, output) = (&picture_features[k], &picture_features[k + 1]);
            if let Some(comparison) = layer.comparison() {
                let target = &target_features[k + 1];
                let compared = comparison.compare(output, target);
                distances.push(compared.distance);
                comparison.add_gradient(output, target, &compared, by_output);
            }
            layer.backward(input, output, by_output, by_input);
            std::mem::swap(by_output, by_input);
        }
        self.cells.cut_backward(by_output, (picture.width(), picture.height()), by_picture);
        // In the order of the layers, for the same bits as without the gradient.
        distances.iter().rev().sum()
    }

    /// Sets the cells of an image and the outputs of all layers.
    fn features(&self, image: PlanarRgb<'_, T>, features: &mut [FeatureMap<T>]) {
        self.cells.cut(image, &mut features[0]);
        for (k, layer) in self.layers.iter().enumerate() {
            let (inputs, outputs) = features.split_at_mut(k + 1);
            layer.forward(&inputs[k], &mut outputs[0]);
        }
    }
}

impl<T: SimdReal> Layer<T> {
    fn comparison(&self) -> Option<&Comparison<T>> {
        match self {
            Self::Convolution(_, comparison) => comparison.as_ref(),
            Self::Pool(_) => None,
        }
    }

    fn forward(&self, input: &FeatureMap<T>, output: &mut FeatureMap<T>) {
        match self {
            Self::Convolution(convolution, _) => convolution.forward(input, output),
            Self::Pool(pool) => pool.forward(input, output),
        }
    }

    /// Sets the derivatives by the input, from those by the output, which are changed.
    fn backward(
        &self,
        input: &FeatureMap<T>,
        output: &FeatureMap<T>,
        by_output: &mut FeatureMap<T>,
        by_input: &mut FeatureMap<T>,
    ) {
        match self {
            Self::Convolution(convolution, _) => {
                by_output.relu_backward(output);
                convolution.backward(by_output, by_input);
            }
            Self::Pool(pool) => pool.backward(input, output, by_output, by_input),
        }
    }
}

/// A convolution of stride 1 with weights of outputs, inputs, rows and columns.
fn convolution<T: SimdReal>(
    layer: &ConvolutionLayer,
    inputs: usize,
    weights: &[T],
    bias: &[T],
) -> Convolution<T> {
    let ConvolutionLayer { channels, side, padding, .. } = *layer;
    let shape = KernelShape { inputs, outputs: channels, side, padding };
    Convolution::new(shape, |o, i, t, u| weights[((o * inputs + i) * side + t) * side + u], bias)
}
