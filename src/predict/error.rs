//! Errors of predicting splats and of the models that predict them.

use crate::fault::ErrorKind;
use crate::io::WriteError;
use crate::nn::features::FeatureError;
use crate::nn::onnx::OnnxError;
use crate::progress::Interrupted;
use std::path::PathBuf;

/// Why no splats can be predicted, or why a model cannot be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum PredictError {
    /// Too few points are left to predict from.
    #[error("{found} points are left in the area, at least {needed} are needed")]
    #[diagnostic(help("the points must be in the coordinate system of the scene, and lie in its area"))]
    FewPoints {
        /// Number of points.
        found: usize,
        /// Smallest number.
        needed: usize,
    },
    /// A file of a model cannot be read.
    #[error("`{path}` cannot be read: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// A file is damaged, or not a model of this version.
    #[error("`{path}` is not a model of this version that predicts splats: {reason}")]
    #[diagnostic(help(
        "`satgs learn OUT.safetensors` trains a model; without `--model` the one that comes with satgs is used"
    ))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A network of others cannot be read or evaluated.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Onnx(#[from] OnnxError),
    /// A network of image features cannot be read or evaluated.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Features(#[from] FeatureError),
    /// The model needs image features that are not given, or none or others than those that are.
    #[error("the model {needed}")]
    #[diagnostic(help(
        "a model takes exactly the `--image-features FILE.onnx` that it was trained with, or none"
    ))]
    OtherFeatures {
        /// What it was trained with.
        needed: String,
    },
    /// The caller asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
    /// A file of a model cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}

impl PredictError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Onnx(e) => e.kind(),
            Self::Features(e) => e.kind(),
            Self::Interrupted(_) => ErrorKind::Interrupted,
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
