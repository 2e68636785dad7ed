//! Errors of features.

use crate::io::Cause;
use std::path::PathBuf;

/// Why features could not be computed, or a network not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FeatureError {
    /// The three colours do not make a picture.
    #[error("the red, green and blue planes of a picture are {}; expected three of one size, and at least one pixel", sizes(.planes))]
    Picture {
        /// Columns, rows and number of values of each plane.
        planes: [(usize, usize, usize); 3],
    },
    /// The cells of [`HandFeatures`](super::HandFeatures) are too small.
    #[error("`cell_px` is {found}, expected at least {least}: smaller cells have no gradients")]
    Cell {
        /// Side of the cells, pixels.
        found: usize,
        /// Smallest side, pixels.
        least: usize,
    },
    /// The file of a network cannot be read.
    #[error("reading the network `{path}` failed: {cause}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the file system.
        cause: std::io::Error,
    },
    /// The file is cut short, or no ONNX model.
    #[error("`{path}` is not a valid ONNX model: {reason} (at byte {at})")]
    #[diagnostic(help("is the file complete?"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where in the file.
        at: usize,
        /// What is wrong there.
        reason: &'static str,
    },
    /// The graph interpolates with cubic polynomials, which the runtime would replace by linear interpolation.
    #[error("`{path}`: node `{node}` is a `Resize` with mode `cubic`, which cannot be computed exactly")]
    #[diagnostic(help(
        "export the network for a fixed size of its input, so that position embeddings are constants"
    ))]
    CubicResize {
        /// The file.
        path: PathBuf,
        /// Name of the node; its first output where it has none.
        node: String,
    },
    /// The runtime refuses the graph.
    #[error("`{path}` cannot be loaded: {cause}")]
    #[diagnostic(help(
        "expected an ONNX model whose name ends in `.onnx`, with weights inside or in a `.data` file beside it"
    ))]
    Load {
        /// The file.
        path: PathBuf,
        /// Error of the runtime.
        cause: Cause,
    },
    /// The graph's input is no picture.
    #[error("`{path}` takes {found}; expected one picture, f32 [1, 3, side, side]")]
    Input {
        /// The file.
        path: PathBuf,
        /// Names, types and shapes of the inputs.
        found: String,
    },
    /// The graph's first output holds no features of patches.
    #[error(
        "`{path}` gives {found} for a picture of {side_px} x {side_px} pixels; expected f32 [1, patches, channels] with at most \
         {most_leading} class or register tokens before the patches, or [1, channels, rows, columns]"
    )]
    #[diagnostic(help("the first output of the graph is used"))]
    Output {
        /// The file.
        path: PathBuf,
        /// Type and shape of the output.
        found: String,
        /// Side of the picture, pixels.
        side_px: usize,
        /// Largest number of leading tokens that are not patches.
        most_leading: usize,
    },
    /// The network cannot be evaluated.
    #[error("evaluating `{path}` failed: {cause}")]
    Run {
        /// The file.
        path: PathBuf,
        /// Error of the runtime.
        cause: Cause,
    },
    /// The network gives infinite features, or none.
    #[error("`{path}` gives features that are not finite")]
    NotFinite {
        /// The file.
        path: PathBuf,
    },
}

fn sizes(planes: &[(usize, usize, usize); 3]) -> String {
    let size =
        |(width, height, values): &(usize, usize, usize)| format!("{width} x {height} ({values} values)");
    planes.each_ref().map(size).join(", ")
}
