//! A scene of either kind.

use super::RunError;
use crate::perspective::{PerspectiveOptions, PerspectiveScene};
use crate::pipeline::PipelineError;
use crate::scene::Scene;
use std::path::{Path, PathBuf};

/// A scene of either kind.
#[derive(Debug)]
pub enum AnyScene {
    /// Images with RPCs.
    Satellites(Box<Scene>),
    /// Images with pinhole cameras.
    Photographs(Box<ReadPhotographs>),
}

/// A perspective scene, with path and options from which a run reads it again.
#[derive(Debug)]
pub struct ReadPhotographs {
    /// Where it lies.
    pub path: PathBuf,
    /// How it was read.
    pub options: PerspectiveOptions,
    /// What was read.
    pub scene: PerspectiveScene,
}

impl AnyScene {
    /// Reads the perspective scene at a path.
    ///
    /// # Errors
    /// [`RunError::Pipeline`] of an image, a camera or an option that is wrong.
    pub fn read_photographs(path: &Path, options: &PerspectiveOptions) -> Result<Self, RunError> {
        let scene = PerspectiveScene::read(path, options).map_err(PipelineError::from)?;
        Ok(Self::Photographs(Box::new(ReadPhotographs {
            path: path.into(),
            options: options.clone(),
            scene,
        })))
    }
}

impl From<Scene> for AnyScene {
    fn from(scene: Scene) -> Self {
        Self::Satellites(Box::new(scene))
    }
}
