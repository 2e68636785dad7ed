//! Why two surface models cannot be compared.

use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::metrics::MetricsError;
use std::path::PathBuf;

/// Why two surface models cannot be compared.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum ChangesError {
    /// The two have too little ground in common.
    #[error("`{earlier}` and `{later}` have {common} cells in common, {needed} are needed")]
    #[diagnostic(help("they cover {extents} (west, south, east, north); are both of one place?"))]
    NoOverlap {
        /// The earlier surface.
        earlier: PathBuf,
        /// The later surface.
        later: PathBuf,
        /// Cells with both.
        common: usize,
        /// Cells that are needed.
        needed: usize,
        /// Bounds and CRS of both, as text.
        extents: String,
    },
    /// A surface cannot be read or brought to the map and the vertical reference of the other.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Metrics(#[from] MetricsError),
    /// There is no transform from the map of the earlier surface.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
}

impl ChangesError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Metrics(e) => e.kind(),
            Self::NoOverlap { .. } | Self::Frame(_) => ErrorKind::Input,
        }
    }
}
