//! Why a run cannot be shown.

use crate::fault::ErrorKind;
use crate::io::{RasterError, VerticalError};
use std::path::PathBuf;

/// Why a run cannot be shown.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum ViewerError {
    /// The folder holds no splats.
    #[error("`{run}` holds no splats")]
    #[diagnostic(help("`satgs train RUN` makes splats.ply"))]
    NoSplats {
        /// The folder.
        run: PathBuf,
    },
    /// The page would be larger than what browsers open.
    #[error("a page with all layers would have {megabytes} MB, and browsers open pages up to {limit} MB")]
    #[diagnostic(help("without --html the run is served, which has no such limit"))]
    TooLarge {
        /// Size of the page, MB.
        megabytes: u64,
        /// Largest size, MB.
        limit: u64,
    },
    /// Two runs cannot be compared.
    #[error("the runs are on different maps: {first}, and {second}")]
    #[diagnostic(help("--compare needs two runs in the same UTM zone, or two without a map"))]
    OtherMap {
        /// What coordinates of the first refer to.
        first: String,
        /// What those of the second refer to.
        second: String,
    },
    /// A file of the page cannot be read.
    #[error("`{name}` of the page cannot be read: {cause}")]
    Unreadable {
        /// Its name.
        name: String,
        /// Error of the operating system.
        cause: std::io::Error,
    },
    /// A mesh cannot be placed.
    #[error("`{path}` cannot be shown: {reason}")]
    #[diagnostic(help("`satgs mesh RUN -o FILE` makes it again"))]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The page cannot be served on this port.
    #[error("port {port} of this machine cannot be used: {cause}")]
    #[diagnostic(help("name another --port, or none: then a free one is chosen"))]
    Port {
        /// The port.
        port: u16,
        /// Error of the operating system.
        cause: std::io::Error,
    },
    /// See [`RasterError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// See [`VerticalError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Vertical(#[from] VerticalError),
}

impl ViewerError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
