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
    /// The run is planned in UTM, of which it lies in several zones.
    #[error("the area lies in two UTM zones: {zones}")]
    #[diagnostic(help("cut it at the border of the zones, and give each part its own --aoi and run folder"))]
    TwoZones {
        /// The zones.
        zones: String,
    },
    /// No tile is covered by enough views.
    #[error("no part of the area is covered by {least} training views")]
    #[diagnostic(help("`satgs info SCENE` shows where the views lie; --aoi chooses another area"))]
    NoViews {
        /// The number of views that a tile needs.
        least: usize,
    },
    /// Even the smallest tile needs more memory than it may.
    #[error("a tile needs {needed_mb:.0} MB of memory, --max-memory is {limit_mb:.0} MB")]
    #[diagnostic(help(
        "--resolution and fewer views reduce it; a machine with more memory allows a larger limit"
    ))]
    Memory {
        /// Memory of the smallest tiles, megabytes.
        needed_mb: f64,
        /// The limit, megabytes.
        limit_mb: f64,
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
