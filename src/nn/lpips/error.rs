//! Why a perceptual distance cannot be computed.

use super::architecture::Backbone;
use std::path::PathBuf;

/// Why weights cannot be read, or images not be compared.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum LpipsError {
    /// The file of the weights is absent or unreadable.
    #[error("weights `{path}` cannot be read: {source}")]
    #[diagnostic(help("scripts/fetch-weights makes lpips-alexnet.safetensors and lpips-vgg16.safetensors"))]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the file system.
        source: std::io::Error,
    },
    /// The file is no complete safetensors file.
    #[error("weights `{path}` are not a complete safetensors file: {source}")]
    #[diagnostic(help(
        "if the file was copied or downloaded, do it again; scripts/fetch-weights makes such files"
    ))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: safetensors::SafeTensorError,
    },
    /// The first convolution is that of no known network.
    #[error("weights `{path}` are of an unknown network: `features.0.weight` has shape {found:?}")]
    #[diagnostic(help(
        "expected [64, 3, 11, 11] (AlexNet) or [64, 3, 3, 3] (VGG16), as torchvision stores them"
    ))]
    Backbone {
        /// The file.
        path: PathBuf,
        /// Shape of the tensor.
        found: Vec<usize>,
    },
    /// A tensor is absent.
    #[error("weights `{path}` have no tensor `{tensor}`")]
    #[diagnostic(help("{} needs it; the file holds the names of torchvision (features.N.weight, features.N.bias) and of LPIPS \
        (lin0.model.1.weight)", backbone.map_or("every network", Backbone::name)))]
    Missing {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// The network, if it is known.
        backbone: Option<Backbone>,
    },
    /// A tensor has another shape than the network.
    #[error("tensor `{tensor}` of weights `{path}` has shape {found:?}, expected {expected:?}")]
    #[diagnostic(help("outputs, inputs, rows, columns of the kernels; the file is of another network"))]
    Shape {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Its shape.
        found: Vec<usize>,
        /// The shape in the network.
        expected: Vec<usize>,
    },
    /// A tensor holds other numbers than f32.
    #[error("tensor `{tensor}` of weights `{path}` has type {found}, expected F32")]
    #[diagnostic(help("convert the weights to 32-bit floating-point numbers"))]
    Type {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Its type as safetensors names it.
        found: String,
    },
    /// A weight is infinite or not a number.
    #[error("tensor `{tensor}` of weights `{path}` holds {found} at index {index}, expected finite numbers")]
    #[diagnostic(help("the file is damaged; scripts/fetch-weights makes it again"))]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Name of the tensor.
        tensor: String,
        /// Index of the first such element.
        index: usize,
        /// Its value.
        found: f32,
    },
    /// A plane of an image does not have its size.
    #[error("channel {channel} of an image of {width} x {height} pixels has {found} values")]
    #[diagnostic(help("each of the three channels has width x height values"))]
    Plane {
        /// Index of the channel, from 0.
        channel: usize,
        /// Columns of the image.
        width: usize,
        /// Rows of the image.
        height: usize,
        /// Number of values.
        found: usize,
    },
    /// The images do not have the same size.
    #[error("images of {} x {} and {} x {} pixels cannot be compared", first.0, first.1, second.0, second.1)]
    #[diagnostic(help("both have to have the same size"))]
    Sizes {
        /// Columns and rows of the first image.
        first: (usize, usize),
        /// Columns and rows of the second image.
        second: (usize, usize),
    },
    /// The images are smaller than what the deepest layer of the network sees.
    #[error("images of {width} x {height} pixels are too small for LPIPS")]
    #[diagnostic(help("the network needs at least {smallest} pixels a side"))]
    TooSmall {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// The smallest number of columns and of rows.
        smallest: usize,
    },
}
