//! Why a plan, a tile job or a mosaic failed.

use crate::io::{RasterError, ReadError, VectorError, WriteError};
use crate::pipeline::{ErrorKind, PipelineError};
use std::path::PathBuf;

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
    /// The plan has no such tile.
    #[error("the plan has no tile `{id}`")]
    #[diagnostic(help("`satgs tile status RUN` lists the tiles"))]
    NoTile {
        /// The ID.
        id: String,
    },
    /// A tile that is needed is not done.
    #[error(
        "tile `{id}` is not done: `{file}` or a file that it lists is missing, or it was made from another plan"
    )]
    #[diagnostic(help("`satgs tile run RUN {id}` makes the tile"))]
    NotDone {
        /// The tile.
        id: String,
        /// Its `done.json`.
        file: PathBuf,
    },
    /// A raster of a tile has not the grid that the plan gives it.
    #[error("`{file}` has not the cells that the plan gives the tile")]
    #[diagnostic(help("the tile was made from another plan; `satgs tile run RUN {id}` makes it anew"))]
    Grid {
        /// The tile.
        id: String,
        /// The raster.
        file: PathBuf,
    },
    /// The cores do not form a lattice, or are too small.
    #[error("tiles `{a}` and `{b}` cannot be blended: {reason}")]
    #[diagnostic(help("`satgs plan SCENE -o RUN` makes a plan that can"))]
    Cores {
        /// A tile.
        a: String,
        /// Its neighbour.
        b: String,
        /// What is wrong.
        reason: &'static str,
    },
    /// No tile is done, so that there is no mosaic.
    #[error("no tile of `{run}` is done")]
    #[diagnostic(help("`satgs tile run RUN ID` makes a tile"))]
    NothingDone {
        /// The run folder.
        run: PathBuf,
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
            Self::NotDone { .. } | Self::NothingDone { .. } => ErrorKind::Failed,
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
