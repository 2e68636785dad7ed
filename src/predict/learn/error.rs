//! Why no model can be trained.

use crate::affine::SiteSceneError;
use crate::checkpoint::CheckpointError;
use crate::fault::ErrorKind;
use crate::io::{RasterError, WriteError};
use crate::perspective::PerspectiveError;
use crate::predict::PredictError;
use crate::progress::Interrupted;
use crate::rpc::formats::FormatError;
use crate::scene::SceneError;
use crate::simulate::SimulateError;
use crate::splat::loss::WeightError;
use std::path::PathBuf;

/// Why no model can be trained.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum LearnError {
    /// A number of the configuration is out of range.
    #[error("`{field}` is {found}, expected {expected}")]
    Config {
        /// The field.
        field: &'static str,
        /// Its value.
        found: String,
        /// What is possible.
        expected: &'static str,
    },
    /// The file of the configuration cannot be read or has other fields.
    #[error("`{path}` is not a configuration: {reason}")]
    #[diagnostic(help("`satgs learn --print-config` prints one"))]
    ConfigFile {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The loss is not a finite number.
    #[error("the loss of round {round} is not finite")]
    #[diagnostic(help("a smaller `rate` may help"))]
    NotFinite {
        /// The round.
        round: usize,
    },
    /// No target shows enough of a tile of a round.
    #[error("the images of round {round} show too little of its tiles")]
    #[diagnostic(help("larger images or more `tiles` help"))]
    NoSamples {
        /// The round.
        round: usize,
    },
    /// A scene has too few depth maps to learn from.
    #[error("`{path}` has {found} training views with depth maps, at least 2 are needed")]
    #[diagnostic(help("RGB-D folders, LEVIR-NVS and ScanNet++ have depth maps"))]
    FewDepths {
        /// The scene.
        path: PathBuf,
        /// Number of views.
        found: usize,
    },
    /// A photographed scene cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Photographs(#[from] PerspectiveError),
    /// See [`WeightError`].
    #[error(transparent)]
    Weight(#[from] WeightError),
    /// There is a training with another configuration.
    #[error("`{path}` belongs to a training with another configuration")]
    #[diagnostic(help("remove the folder, or choose another name for the model"))]
    OtherTraining {
        /// The checkpoint.
        path: PathBuf,
    },
    /// See [`SimulateError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Simulate(#[from] SimulateError),
    /// See [`SceneError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// See [`SiteSceneError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Site(#[from] SiteSceneError),
    /// See [`FormatError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Rpc(#[from] FormatError),
    /// See [`RasterError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// See [`PredictError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Predict(#[from] PredictError),
    /// See [`WriteError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// See [`CheckpointError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// See [`Interrupted`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
}

impl LearnError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::NotFinite { .. } => ErrorKind::Failed,
            Self::Photographs(e) => e.kind(),
            Self::Simulate(e) => e.kind(),
            Self::Scene(e) => e.kind(),
            Self::Site(e) => e.kind(),
            Self::Raster(e) => e.kind(),
            Self::Predict(e) => e.kind(),
            Self::Write(e) => e.kind(),
            Self::Interrupted(_) => ErrorKind::Interrupted,
            _ => ErrorKind::Input,
        }
    }
}
