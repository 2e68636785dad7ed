//! The folder of an exported COLMAP project, which appears when it is complete.

use super::PipelineError;
use super::export_folder::{ExportFolder, SUMMARY};
use super::exported::ExportedView;
use crate::export::{ExportError, Resampled};
use crate::frame::SiteGrid;
use crate::io::{write_file, write_json, write_png_gray};
use crate::perspective::colmap::{self, ColmapModel, Format};
use std::path::Path;

/// Images, and masks of those that have pixels without data.
const IMAGES: &str = "images";
const MASKS: &str = "masks";
/// The model, and the images that were held back from training, where 3DGS looks for them.
const SPARSE: &str = "sparse";
const MODEL: &str = "sparse/0";
const TEST_LIST: &str = "test.txt";
/// The place on Earth.
const GEOREFERENCE: &str = "georef.json";

/// The files of a project, until all are complete.
pub(super) struct ColmapFolder(ExportFolder);

impl ColmapFolder {
    /// See [`ExportFolder::new`].
    pub fn new(target: &Path, overwrite: bool) -> Result<Self, PipelineError> {
        Ok(Self(ExportFolder::new(target, SUMMARY, overwrite)?))
    }

    /// Refuses a folder that holds an image of the scene itself, which the project would replace.
    pub fn require_other_than(&self, source: &Path) -> Result<(), PipelineError> {
        match (source.canonicalize(), self.0.target().canonicalize()) {
            (Ok(source), Ok(target)) if source.starts_with(&target) => {
                Err(ExportError::OwnScene { folder: self.0.target().into() }.into())
            }
            _ => Ok(()),
        }
    }

    /// Writes an image, and its mask under the name that COLMAP looks for.
    pub fn write_image(&self, name: &str, image: &Resampled) -> Result<(), PipelineError> {
        let Resampled { colors, mask } = image;
        colors.write(&self.0.path(IMAGES).join(name))?;
        if let Some(mask) = mask {
            let path = self.0.path(MASKS).join(format!("{name}.png"));
            write_png_gray(&path, colors.width, colors.height, mask)?;
        }
        Ok(())
    }

    /// Writes the rest and moves all to its place; other files there stay.
    pub fn finish(
        self,
        model: &ColmapModel,
        format: Format,
        views: &[ExportedView],
        site: Option<&SiteGrid>,
    ) -> Result<(), PipelineError> {
        let path = |name: &str| self.0.path(name);
        colmap::write(&path(MODEL), model, format)?;
        write_json(&path(SUMMARY), &views)?;
        let test: Vec<&str> = views.iter().filter(|v| v.is_test).map(|v| v.image.as_str()).collect();
        if !test.is_empty() {
            write_file(&path(MODEL).join(TEST_LIST), test.join("\n") + "\n")?;
        }
        if let Some(site) = site {
            write_json(&path(GEOREFERENCE), &crate::io::georeference(site))?;
        }
        self.0.finish(&[SUMMARY, IMAGES, MASKS, SPARSE, GEOREFERENCE])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn a_folder_with_images_of_the_scene_is_refused() {
        let scene = tempfile::tempdir().unwrap();
        let image = scene.path().join("images/a.jpg");
        fs::create_dir(scene.path().join("images")).unwrap();
        fs::write(&image, "").unwrap();
        assert!(ColmapFolder::new(scene.path(), true).is_err(), "no export made the folder");
        fs::write(scene.path().join(SUMMARY), "[]").unwrap();
        let onto_it = ColmapFolder::new(scene.path(), true).unwrap();
        assert!(onto_it.require_other_than(&image).is_err());
        let beside_it = ColmapFolder::new(&scene.path().join("new"), false).unwrap();
        assert!(beside_it.require_other_than(&image).is_ok());
    }
}
