//! The files of a run folder that later stages read: the scene, and the cameras with what was trained beside splats.

use super::super::PipelineError;
use super::perspective_manifest::refuse;
use super::tiled::require_one_area;
use crate::affine::{SiteScene, SiteView};
use crate::io::{ImageFile, read_json, vsi};
use crate::run_files::{CAMERAS, SCENE, SPLATS};
use crate::scene::{Scene, View};
use crate::splat::appearance::Appearance;
use crate::splat::ply::{self, PlyError};
use crate::splat::recipe::{Recipe, SatelliteRecipe};
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_from_color};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::path::Path;

/// The content of `cameras.json`: cameras in the site frame, their colour models, and the recipe they were trained by.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct TrainedCameras {
    /// Site, area, cameras.
    #[serde(flatten)]
    pub setup: SiteScene,
    /// Name of every training view, and its parameters of the colour model.
    pub appearances: Vec<(String, Appearance)>,
    /// What was trained by.
    pub recipe: Recipe<SatelliteRecipe>,
    /// Whether [`SURFACE`](crate::run_files::SURFACE) holds the trained surface matched with the views.
    pub is_matched: bool,
}

impl TrainedCameras {
    /// Reads the cameras of a run folder.
    ///
    /// # Errors
    /// [`PipelineError::RunFile`], [`PipelineError::OfTiles`].
    pub fn read(run: &Path) -> Result<Self, PipelineError> {
        refuse(run)?;
        require_one_area(run)?;
        let made_by = "`satgs train RUN` makes it";
        read_json(&run.join(CAMERAS)).map_err(|source| PipelineError::RunFile { source, made_by })
    }

    /// Reads the splats of a run folder; their colours are linear.
    ///
    /// # Errors
    /// [`PipelineError::Ply`].
    pub fn read_splats(&self, run: &Path) -> Result<Splats, PipelineError> {
        let path = run.join(SPLATS);
        let mut splats = ply::read(&path)?;
        if !splats.f_rest.is_empty() {
            let reason =
                "it has spherical harmonics above degree 0 (`f_rest_*`), which satellite runs do not have";
            return Err(PlyError::Format { path, reason: reason.into() }.into());
        }
        if !self.setup.transfer_function.is_linear() {
            splats.recolor(|v| self.setup.transfer_function.linear(v));
        }
        Ok(splats)
    }

    /// Writes splats of linear colours into a run folder, encoded for display as viewers expect them.
    ///
    /// # Errors
    /// [`PipelineError::Write`].
    pub fn write_splats(&self, run: &Path, splats: &Splats) -> Result<(), PipelineError> {
        let mut shown = Cow::Borrowed(splats);
        if !self.setup.transfer_function.is_linear() {
            shown.to_mut().recolor(|v| self.setup.transfer_function.encoded(v));
        }
        Ok(ply::write(&run.join(SPLATS), &shown, &self.setup.site)?)
    }

    /// Reads the splats of a run folder in the colours of the orthophoto: those of the reference view in full sunlight,
    /// encoded for display.
    ///
    /// # Errors
    /// [`PipelineError::Ply`].
    pub fn read_shown_splats(&self, run: &Path) -> Result<Splats, PipelineError> {
        Ok(self.shown(self.read_splats(run)?))
    }

    /// Splats of linear colours in those of the orthophoto.
    #[must_use]
    pub fn shown(&self, mut splats: Splats) -> Splats {
        let reference = self.reference_appearance();
        let sunlit = reference.sunlit();
        let encode = |v| self.setup.transfer_function.encoded(v);
        for f_dc in &mut splats.f_dc {
            *f_dc = f_dc_from_color(sunlit(color_from_f_dc(*f_dc)).map(encode));
        }
        splats
    }

    /// The view of this name.
    ///
    /// # Errors
    /// [`PipelineError::NoView`], which lists the views.
    pub fn find(&self, name: &str) -> Result<&SiteView, PipelineError> {
        let views = &self.setup.views;
        views.iter().find(|v| v.name == name).ok_or_else(|| {
            let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
            PipelineError::NoView { name: name.into(), views: names.join(", ") }
        })
    }

    /// The colour model of the view whose colours the orthophoto takes.
    pub fn reference_appearance(&self) -> Appearance {
        let reference = self.appearances.get(self.setup.reference_among_training());
        reference.map(|a| a.1.clone()).unwrap_or_default()
    }
}

/// Reads the scene of a run folder: the views that were adjusted.
///
/// # Errors
/// [`PipelineError::RunFile`].
pub fn read_scene(run: &Path) -> Result<Scene, PipelineError> {
    refuse(run)?;
    let made_by = "`satgs ba SCENE -o RUN` makes it";
    read_json(&run.join(SCENE)).map_err(|source| PipelineError::RunFile { source, made_by })
}

/// An error when an image that a run was made from is no longer where it was.
pub fn require_images(scene: &Scene) -> Result<(), PipelineError> {
    scene.views.iter().try_for_each(require_image)
}

/// As [`require_images`], of one view.
pub fn require_image(view: &View) -> Result<(), PipelineError> {
    if vsi::is_virtual(&view.image) {
        // What GDAL says tells a server that is down from an image that is gone.
        return Ok(ImageFile::open(&view.image).map(drop)?);
    }
    if view.image.exists() {
        return Ok(());
    }
    Err(PipelineError::ImageMoved { image: view.image.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};
    use crate::scene::TransferFunction;

    #[test]
    fn splats_are_light_in_memory_and_brightness_in_their_file() {
        let folder = tempfile::tempdir().unwrap();
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.0, -20.0) };
        let transfer_function = TransferFunction::new(2.2).unwrap();
        let setup = SiteScene {
            site,
            area: (0.0, 0.0, 1.0, 1.0),
            altitudes: (0.0, 1.0),
            searched: (0.0, 1.0),
            views: vec![],
            reference: 0,
            is_framed: false,
            transfer_function,
        };
        let recipe = Recipe::named("best").unwrap().of_kind().unwrap();
        let cameras = TrainedCameras { setup, appearances: vec![], recipe, is_matched: false };
        let mut splats = Splats::default();
        splats.push([0.5; 3], 0.3, 0.9, [0.1, 0.3, -0.02]);
        cameras.write_splats(folder.path(), &splats).unwrap();
        let near =
            |a: &Splats, b: &Splats| a.f_dc[0].iter().zip(b.f_dc[0]).all(|(a, b)| (a - b).abs() < 1e-4);
        let shown = ply::read(&folder.path().join(SPLATS)).unwrap();
        let mut expected = Splats::default();
        expected.push([0.5; 3], 0.3, 0.9, [0.1, 0.3, -0.02].map(|v| transfer_function.encoded(v)));
        assert!(near(&shown, &expected), "{:?}", shown.f_dc);
        let read = cameras.read_splats(folder.path()).unwrap();
        assert!(near(&read, &splats), "{:?}", read.f_dc);
    }
}
