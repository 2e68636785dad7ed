//! What stages leave in a run's folder for each other: how it is read and written.

use super::{Failure, align};
use crate::affine::SiteScene;
use crate::io::{RasterError, write_file};
use crate::run_files::{CAMERAS, SCENE, SPLATS};
use crate::scene::{Scene, View};
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::splat::splats::Splats;
use crate::splat::train::recipe::Recipe;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::Path;

/// What [`CAMERAS`] holds.
#[derive(Serialize, Deserialize)]
pub struct TrainedCameras {
    /// Site, area, cameras.
    #[serde(flatten)]
    pub setup: SiteScene,
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

    /// Reads a run's splats, coloured in light.
    pub fn read_splats(&self, run: &Path) -> Result<Splats, Failure> {
        let mut splats = ply::read(&run.join(SPLATS))?;
        if !self.setup.tone.is_linear() {
            splats.recolor(|v| self.setup.tone.light(v));
        }
        Ok(splats)
    }

    /// Writes a run's splats, coloured in light, as viewers show them.
    pub fn write_splats(&self, run: &Path, splats: &Splats) -> Result<(), Failure> {
        let mut shown = Cow::Borrowed(splats);
        if !self.setup.tone.is_linear() {
            shown.to_mut().recolor(|v| self.setup.tone.brightness(v));
        }
        Ok(ply::write(&run.join(SPLATS), &shown, &self.setup.site)?)
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

/// An error when an image that a run was made of is no longer where it was.
pub fn require_images(scene: &Scene) -> Result<(), Failure> {
    scene.views.iter().try_for_each(require_image)
}

/// As [`require_images`], of one view.
pub fn require_image(view: &View) -> Result<(), Failure> {
    if view.image.exists() {
        return Ok(());
    }
    Err(Failure::input(
        format!("`{}` is gone, of which the run was made", view.image.display()),
        "`satgs ba SCENE -o RUN` tells the run where its images have moved to",
    ))
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::scene::Tone;

    #[test]
    fn splats_are_light_in_memory_and_brightness_in_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
        let tone = Tone::new(2.2).unwrap();
        let setup = SiteScene {
            site,
            area: (0.0, 0.0, 1.0, 1.0),
            altitudes: (0.0, 1.0),
            views: vec![],
            reference: 0,
            tone,
        };
        let recipe = Recipe::named("best").unwrap();
        let cameras = TrainedCameras { setup, appearances: vec![], recipe, is_matched: false };
        let mut splats = Splats::default();
        splats.push([0.5; 3], 0.3, 0.9, [0.1, 0.3, -0.02]);
        cameras.write_splats(folder.path(), &splats).unwrap();
        let near =
            |a: &Splats, b: &Splats| a.f_dc[0].iter().zip(b.f_dc[0]).all(|(a, b)| (a - b).abs() < 1e-4);
        let shown = ply::read(&folder.path().join(SPLATS)).unwrap();
        let mut expected = Splats::default();
        expected.push([0.5; 3], 0.3, 0.9, [0.1, 0.3, -0.02].map(|v| tone.brightness(v)));
        assert!(near(&shown, &expected), "{:?}", shown.f_dc);
        let read = cameras.read_splats(folder.path()).unwrap();
        assert!(near(&read, &splats), "{:?}", read.f_dc);
    }
}
