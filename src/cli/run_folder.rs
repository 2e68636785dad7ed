//! What stages leave in a run's folder for each other: how it is read and written.

use super::{Failure, align};
use crate::raster::{RasterError, write_file};
use crate::run_files::{CAMERAS, SCENE};
use crate::scene::Scene;
use crate::splat::appearance::Appearance;
use crate::splat::recipe::Recipe;
use crate::splat::setup::Setup;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// What [`CAMERAS`] holds.
#[derive(Serialize, Deserialize)]
pub struct TrainedCameras {
    /// Site, area, cameras.
    #[serde(flatten)]
    pub setup: Setup,
    /// Name and radiometry of every training view.
    pub appearances: Vec<(String, Appearance)>,
    /// What was trained by.
    pub recipe: Recipe,
    /// Whether [`SURFACE`](crate::run_files::SURFACE) holds the trained surface matched with the views.
    pub is_matched: bool,
}

impl TrainedCameras {
    /// Reads a run's cameras, aligned if an alignment was interrupted.
    pub fn read(run: &Path) -> Result<Self, Failure> {
        align::finish(run)?;
        read_json(&run.join(CAMERAS), "`satgs train RUN` makes it")
    }

    /// The radiometry of the view whose colours the orthophoto takes.
    pub fn reference_appearance(&self) -> Appearance {
        let reference = self.appearances.get(self.setup.reference_among_training());
        reference.map(|a| a.1).unwrap_or_default()
    }
}

/// Reads a run's scene.
pub fn read_scene(run: &Path) -> Result<Scene, Failure> {
    read_json(&run.join(SCENE), "`satgs ba SCENE -o RUN` makes it")
}

/// Reads a JSON file of a run's folder; `made_by` is the hint when it is absent.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path, made_by: &str) -> Result<T, Failure> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| Failure::input(format!("`{}` cannot be read: {e}", path.display()), made_by))?;
    serde_json::from_str(&text)
        .map_err(|e| Failure::input(format!("`{}` is damaged: {e}", path.display()), made_by))
}

/// Writes a JSON file of a run's folder.
pub fn write_json<T: Serialize>(path: &Path, value: &T) -> Result<(), Failure> {
    let failed = |reason: String| RasterError::Write { path: path.into(), reason };
    let text = serde_json::to_string_pretty(value).map_err(|e| failed(e.to_string()))?;
    Ok(write_file(path, text)?)
}
