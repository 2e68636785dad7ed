//! Why a run failed.

use crate::pipeline::{ErrorKind, PipelineError};
use crate::tiles::TilesError;

/// Why a run failed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
pub enum RunError {
    /// A stage of the scene as a whole failed.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Pipeline(#[from] PipelineError),
    /// The plan, a tile or the mosaic failed.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Tiles(#[from] Box<TilesError>),
}

impl From<TilesError> for RunError {
    fn from(error: TilesError) -> Self {
        Box::new(error).into()
    }
}

impl RunError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Pipeline(e) => e.kind(),
            Self::Tiles(e) => e.kind(),
        }
    }
}
