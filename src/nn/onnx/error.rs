//! Errors of networks from ONNX files.

use crate::io::Cause;
use std::path::PathBuf;

/// Why a network cannot be read or evaluated.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum OnnxError {
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
    #[error("`{path}` takes {found}; expected one picture, f32 {expected}")]
    Input {
        /// The file.
        path: PathBuf,
        /// Names, types and shapes of the inputs.
        found: String,
        /// The shape of a picture.
        expected: &'static str,
    },
    /// The graph has other inputs.
    #[error("`{path}` takes {found}; expected {expected}")]
    Names {
        /// The file.
        path: PathBuf,
        /// Names of its inputs.
        found: String,
        /// Expected names.
        expected: String,
    },
    /// The graph has no output.
    #[error("`{path}` gives no output")]
    NoOutput {
        /// The file.
        path: PathBuf,
    },
    /// The network cannot be evaluated.
    #[error("evaluating `{path}` failed: {cause}")]
    Run {
        /// The file.
        path: PathBuf,
        /// Error of the runtime.
        cause: Cause,
    },
}
