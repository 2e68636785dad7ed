//! Errors of the simulation.

use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::io::{RasterError, VerticalError, WriteError};
use crate::progress::Interrupted;
use crate::rpc::{LocalizeError, RpcError};
use std::path::PathBuf;

/// Why a scene could not be simulated.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum SimulateError {
    /// An option is outside of its range.
    #[error("`{option}` is {found}, expected {expected}")]
    #[diagnostic(help("`satgs simulate --help` lists the defaults"))]
    Option {
        /// Name of the option.
        option: &'static str,
        /// The given value.
        found: String,
        /// The valid values.
        expected: &'static str,
    },
    /// A planned time is none.
    #[error("`{found}` is no time of an image")]
    #[diagnostic(help("expected a date and a time of day in UTC, such as 2024-07-15T10:30"))]
    Time {
        /// The given text.
        found: String,
    },
    /// The sun is too low at a planned time.
    #[error("the sun is {elevation_deg:.0} degrees high at {acquired}, expected 5 degrees or more")]
    #[diagnostic(help("times of images are in UTC"))]
    Night {
        /// The planned time.
        acquired: String,
        /// Elevation of the sun, degrees.
        elevation_deg: f64,
    },
    /// A surface or a picture cannot be used.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help(
        "--surface and --texture take north-up rasters in one projected CRS in metres that show the same place"
    ))]
    Surface {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A surface or a picture cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// The vertical reference of a surface is not known.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Vertical(#[from] VerticalError),
    /// The output folder is not empty.
    #[error("`{path}` is not empty")]
    #[diagnostic(help("--overwrite replaces an earlier simulation; another folder keeps both"))]
    NotEmpty {
        /// The folder.
        path: PathBuf,
    },
    /// An output could not be written, or the folder not be created or cleared.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
    /// The map projection is not available.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// The fitted camera of a view is not a valid RPC.
    #[error("the simulated camera of `{view}` is not a valid RPC")]
    Rpc {
        /// The view.
        view: String,
        /// What is wrong with it.
        source: RpcError,
    },
    /// The line of sight of a pixel cannot be computed from the fitted RPC.
    #[error("the simulated camera of `{view}` has no line of sight for every pixel")]
    Ray {
        /// The view.
        view: String,
        /// The pixel and height.
        source: LocalizeError,
    },
}

impl SimulateError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            Self::Write(e) => e.kind(),
            Self::Interrupted(_) => ErrorKind::Interrupted,
            Self::Rpc { .. } | Self::Ray { .. } => ErrorKind::Failed,
            _ => ErrorKind::Input,
        }
    }
}
