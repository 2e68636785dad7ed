//! Errors of features.

use crate::fault::ErrorKind;
use crate::nn::onnx::OnnxError;
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
    /// See [`OnnxError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Onnx(#[from] OnnxError),
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
    /// The network gives infinite features, or none.
    #[error("`{path}` gives features that are not finite")]
    NotFinite {
        /// The file.
        path: PathBuf,
    },
}

impl FeatureError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Onnx(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

fn sizes(planes: &[(usize, usize, usize); 3]) -> String {
    let size =
        |(width, height, values): &(usize, usize, usize)| format!("{width} x {height} ({values} values)");
    planes.each_ref().map(size).join(", ")
}
