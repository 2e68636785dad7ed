//! The scene in `data/town`, for the examples that are called without arguments, and runs of it.

// Every example uses a part of it.
#![allow(dead_code)]

use satgs::pipeline::{AdjustOptions, DsmOptions, PipelineError, TrainOptions, adjust, dsm, train};
use satgs::progress::NoProgress;
use satgs::scene::{self, ReadOptions};
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// The scene, and a folder for results that is removed when it is dropped.
pub struct Town {
    results: TempDir,
}

impl Town {
    /// The scene, with an empty folder for results.
    pub fn new() -> std::io::Result<Self> {
        Ok(Self { results: tempfile::tempdir()? })
    }

    /// The folder with the images.
    pub fn scene(&self) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("data/town")
    }

    /// The exact surface model.
    pub fn truth(&self) -> PathBuf {
        self.scene().join("truth/TOWN_DSM.tif")
    }

    /// A folder for results.
    pub fn run(&self) -> PathBuf {
        self.results.path().join("run")
    }

    /// Adjusts, trains (far too briefly) and renders the scene.
    pub fn trained(&self) -> Result<PathBuf, PipelineError> {
        let run = self.run();
        let scene = scene::read(&self.scene(), &ReadOptions::default())?;
        adjust(&scene, &AdjustOptions::default(), &run, &NoProgress)?;
        train(&run, &brief(), &NoProgress)?;
        dsm(&run, &DsmOptions::default(), &NoProgress)?;
        Ok(run)
    }
}

/// A training of a second or two, to show how it is done.
pub fn brief() -> TrainOptions {
    TrainOptions { recipe: "baeogs".into(), iterations: Some(20), ..TrainOptions::default() }
}
