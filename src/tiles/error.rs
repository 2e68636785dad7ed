//! Why a plan, a tile job or a mosaic failed.

use crate::io::{RasterError, ReadError, VectorError, WriteError};
use crate::pipeline::{ErrorKind, PipelineError};

/// Why a plan, a tile job or a mosaic failed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum TilesError {
    /// A file of the run folder is missing or damaged.
    #[error("{source}")]
    #[diagnostic(help("{made_by}"))]
    RunFile {
        /// The file, and why it cannot be read.
        source: ReadError,
        /// The command that makes it.
        made_by: &'static str,
    },
    /// See [`PipelineError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Pipeline(#[from] PipelineError),
}

impl TilesError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Pipeline(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

impl From<WriteError> for TilesError {
    fn from(e: WriteError) -> Self {
        Self::Pipeline(e.into())
    }
}

impl From<RasterError> for TilesError {
    fn from(e: RasterError) -> Self {
        Self::Pipeline(e.into())
    }
}

impl From<VectorError> for TilesError {
    fn from(e: VectorError) -> Self {
        Self::Pipeline(e.into())
    }
}
