//! Errors of networks from ONNX files.

use crate::fault::ErrorKind;
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
    /// The graph has operators of a version that is not known.
    #[error("`{path}` has operators of version {}, expected 7 to 28", stated(.found))]
    #[diagnostic(help("export the network for another `opset_version`, such as 17"))]
    Version {
        /// The file.
        path: PathBuf,
        /// Its version of the operators; none if it states none.
        found: Option<i64>,
    },
    /// An operator cannot be computed as it is defined.
    #[error("`{path}`: node `{node}`, a `{op_type}`, cannot be computed: {reason}")]
    #[diagnostic(help(
        "export the network for a newer `opset_version`, such as 17, or without this operator"
    ))]
    Operator {
        /// The file.
        path: PathBuf,
        /// Name of the node; its first output where it has none.
        node: String,
        /// Its operator.
        op_type: String,
        /// What is not supported.
        reason: String,
    },
    /// The network needs more memory than there is.
    #[error(
        "`{path}` needs about {needed_mb:.0} MB for a picture of {columns} x {rows} pixels, this machine has {available_mb:.0} MB; \
         its largest tensor `{node}` is {shape:?}"
    )]
    #[diagnostic(help("export the network for a smaller picture, or run it on a machine with more memory"))]
    Memory {
        /// The file.
        path: PathBuf,
        /// Sides of the picture, pixels.
        columns: usize,
        /// See `columns`.
        rows: usize,
        /// Memory of the tensors that are needed at once, megabytes.
        needed_mb: f64,
        /// Memory of the machine, megabytes.
        available_mb: f64,
        /// Name of the largest tensor.
        node: String,
        /// Its shape.
        shape: Vec<usize>,
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
    #[diagnostic(help(
        "does the network take pictures as f32 [1, 3, rows, columns], and does onnxruntime run it?"
    ))]
    Run {
        /// The file.
        path: PathBuf,
        /// Error of the runtime.
        cause: Cause,
    },
}

impl OnnxError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Memory { .. } => ErrorKind::Resources,
            _ => ErrorKind::Input,
        }
    }
}

/// A version, if a file states one.
fn stated(version: &Option<i64>) -> String {
    version.map_or_else(|| "none".to_owned(), |version| version.to_string())
}
