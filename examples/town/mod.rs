//! A tiny simulated scene for the examples that are called without arguments, and runs of it.

// Every example uses a part of it.
#![allow(dead_code)]

use satgs::pipeline::{AdjustOptions, DsmOptions, PipelineError, TrainOptions, adjust, dsm, train};
use satgs::progress::NoProgress;
use satgs::scene::{self, ReadOptions};
use satgs::simulate::{SimulateOptions, simulate};
use std::path::PathBuf;
use tempfile::TempDir;

/// A folder that is removed when it is dropped, with a scene of four images of 140 x 140 pixels in `scene`.
pub struct Town {
    folder: TempDir,
}

impl Town {
    /// Simulates the scene.
    pub fn new() -> Result<Self, Box<dyn std::error::Error>> {
        let town = Self { folder: tempfile::tempdir()? };
        let options = SimulateOptions { views: 4, size_px: 140, ..SimulateOptions::default() };
        simulate(&town.scene(), &options, &NoProgress)?;
        Ok(town)
    }

    /// The folder with the images.
    pub fn scene(&self) -> PathBuf {
        self.folder.path().join("scene")
    }

    /// The exact surface model.
    pub fn truth(&self) -> PathBuf {
        self.scene().join("truth/TOWN_DSM.tif")
    }

    /// A folder for results.
    pub fn run(&self) -> PathBuf {
        self.folder.path().join("run")
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
