//! How a simulation fails.

use crate::frame::FrameError;
use crate::io::WriteError;
use crate::progress::Interrupted;
use crate::rpc::{LocalizeError, RpcError};
use std::path::PathBuf;

/// Why a scene could not be simulated.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum SimulateError {
    /// An option out of its range.
    #[error("`{option}` is {found}, expected {expected}")]
    #[diagnostic(help("`satgs simulate --help` tells the defaults"))]
    Option {
        /// Name of the option.
        option: &'static str,
        /// What was found.
        found: String,
        /// What would do.
        expected: &'static str,
    },
    /// The folder holds something.
    #[error("`{path}` is not empty")]
    #[diagnostic(help("--overwrite replaces an earlier simulation; another folder keeps both"))]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// The folder cannot be read, created or cleared.
    #[error("`{path}`: {cause}")]
    Folder {
        /// The folder or file.
        path: PathBuf,
        /// Error of the file system.
        cause: std::io::Error,
    },
    /// An output could not be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
    /// No map projection.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// The fitted camera is no RPC.
    #[error("the simulated camera of `{view}` is no RPC")]
    Rpc {
        /// The view.
        view: String,
        /// What is wrong with it.
        source: RpcError,
    },
    /// A ray leaves the RPC's volume.
    #[error("the simulated camera of `{view}` has no line of sight for every pixel")]
    Ray {
        /// The view.
        view: String,
        /// Where.
        source: LocalizeError,
    },
}
