//! The layers of the networks that LPIPS compares images by, as torchvision numbers them.

use crate::nn::max_pool::MaxPool;

/// The network whose layers LPIPS compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Backbone {
    /// AlexNet (Krizhevsky 2014): fast, and the usual choice for scores.
    AlexNet,
    /// VGG16 (Simonyan and Zisserman 2015): the usual choice for losses.
    Vgg16,
}

impl Backbone {
    /// The usual name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::AlexNet => "AlexNet",
            Self::Vgg16 => "VGG16",
        }
    }

    /// Columns and rows, pixels, that an image needs at least, so that every layer has a pixel: 31 for AlexNet, 16 for VGG16.
    #[must_use]
    pub fn smallest_side_px(self) -> usize {
        self.architecture().smallest_side()
    }

    /// The network whose first convolution has weights of this shape.
    pub(super) fn of_first_weights(shape: &[usize]) -> Option<Self> {
        [Self::AlexNet, Self::Vgg16].into_iter().find(|backbone| {
            let first = backbone.architecture().first;
            shape == [first.channels, 3, first.side, first.side]
        })
    }

    /// The layers up to the last one that is compared.
    pub(super) fn architecture(self) -> Architecture {
        match self {
            Self::AlexNet => ALEXNET,
            Self::Vgg16 => VGG16,
        }
    }
}

/// A convolution followed by a ReLU.
#[derive(Clone, Copy)]
pub(super) struct ConvolutionLayer {
    /// Index of the layer in torchvision's `features`.
    pub(super) index: usize,
    /// Channels of the output.
    pub(super) channels: usize,
    /// Columns and rows of the kernels.
    pub(super) side: usize,
    /// Columns and rows of zeros around the input.
    pub(super) padding: usize,
    /// Whether the output, after the ReLU, is one of the layers by which images are compared.
    pub(super) compared: bool,
}

impl ConvolutionLayer {
    pub(super) const fn new(index: usize, channels: usize, side: usize, padding: usize) -> Self {
        Self { index, channels, side, padding, compared: false }
    }

    pub(super) const fn compared(self) -> Self {
        Self { compared: true, ..self }
    }

    /// Columns or rows that are needed for so many outputs.
    fn input_side(self, outputs: usize, stride: usize) -> usize {
        ((outputs - 1) * stride + self.side).saturating_sub(2 * self.padding).max(1)
    }
}

/// A layer after the first.
#[derive(Clone, Copy)]
pub(super) enum LayerKind {
    /// A convolution of stride 1.
    Convolution(ConvolutionLayer),
    /// Maxima over windows.
    Pool(MaxPool),
}

/// A sequence of layers. The last one is compared.
#[derive(Clone, Copy)]
pub(super) struct Architecture {
    /// The convolution of the image.
    pub(super) first: ConvolutionLayer,
    /// Distance between pixels of the image that neighbouring outputs of the first convolution are centred on.
    pub(super) stride: usize,
    /// The other layers.
    pub(super) others: &'static [LayerKind],
}

impl Architecture {
    /// Columns and rows, pixels, of the smallest image for which every layer has an output.
    pub(super) fn smallest_side(&self) -> usize {
        let input_side = |outputs, layer: &LayerKind| match layer {
            LayerKind::Convolution(convolution) => convolution.input_side(outputs, 1),
            LayerKind::Pool(pool) => pool.input_side(outputs),
        };
        self.first.input_side(self.others.iter().rev().fold(1, input_side), self.stride)
    }
}

pub(super) const fn conv(index: usize, channels: usize, side: usize, padding: usize) -> LayerKind {
    LayerKind::Convolution(ConvolutionLayer::new(index, channels, side, padding))
}

pub(super) const fn compared(index: usize, channels: usize, side: usize, padding: usize) -> LayerKind {
    LayerKind::Convolution(ConvolutionLayer::new(index, channels, side, padding).compared())
}

pub(super) const fn pool(side: usize) -> LayerKind {
    LayerKind::Pool(MaxPool { side })
}

/// AlexNet as in torchvision; LPIPS compares the outputs of all its ReLUs.
const ALEXNET: Architecture = Architecture {
    first: ConvolutionLayer::new(0, 64, 11, 2).compared(),
    stride: 4,
    others: &[
        pool(3),
        compared(3, 192, 5, 2),
        pool(3),
        compared(6, 384, 3, 1),
        compared(8, 256, 3, 1),
        compared(10, 256, 3, 1),
    ],
};

/// VGG16 as in torchvision; LPIPS compares relu1_2, relu2_2, relu3_3, relu4_3 and relu5_3.
const VGG16: Architecture = Architecture {
    first: ConvolutionLayer::new(0, 64, 3, 1),
    stride: 1,
    others: &[
        compared(2, 64, 3, 1),
        pool(2),
        conv(5, 128, 3, 1),
        compared(7, 128, 3, 1),
        pool(2),
        conv(10, 256, 3, 1),
        conv(12, 256, 3, 1),
        compared(14, 256, 3, 1),
        pool(2),
        conv(17, 512, 3, 1),
        conv(19, 512, 3, 1),
        compared(21, 512, 3, 1),
        pool(2),
        conv(24, 512, 3, 1),
        conv(26, 512, 3, 1),
        compared(28, 512, 3, 1),
    ],
};
