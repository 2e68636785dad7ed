//! The folder of an exported COLMAP project, which appears when it is complete.

use super::PipelineError;
use super::exported::ExportedView;
use crate::export::{ExportError, Resampled};
use crate::frame::SiteGrid;
use crate::io::{WriteError, write_file, write_json, write_png_gray};
use crate::perspective::colmap::{self, ColmapModel, Format};
use std::fs;
use std::path::{Path, PathBuf};

/// Images, and masks of those that have pixels without data.
const IMAGES: &str = "images";
const MASKS: &str = "masks";
/// The model, and the images that were held back from training, where 3DGS looks for them.
const SPARSE: &str = "sparse";
const MODEL: &str = "sparse/0";
const TEST_LIST: &str = "test.txt";
/// What was exported, by which a later export knows a folder whose contents it may replace.
const SUMMARY: &str = "export.json";
/// The place on Earth.
const GEOREFERENCE: &str = "georef.json";

/// Files beside their final folder, until all are complete.
pub(super) struct ColmapFolder {
    target: PathBuf,
    staging: tempfile::TempDir,
}

impl ColmapFolder {
    /// A folder that will appear at `target`, which must be empty or missing; with `overwrite` it replaces what an earlier
    /// export wrote there.
    pub fn new(target: &Path, overwrite: bool) -> Result<Self, PipelineError> {
        let failed = |e: std::io::Error| WriteError::new(target, e);
        let first = match fs::read_dir(target) {
            Ok(mut entries) => entries.next(),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(e) => return Err(failed(e).into()),
        };
        if first.is_some() && !(overwrite && target.join(SUMMARY).exists()) {
            return Err(ExportError::NotEmpty { folder: target.into() }.into());
        }
        let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(failed)?;
        let staging = tempfile::Builder::new().prefix(".satgs-").tempdir_in(parent).map_err(failed)?;
        Ok(Self { target: target.into(), staging })
    }

    /// Refuses a folder that holds an image of the scene itself, which the project would replace.
    pub fn require_other_than(&self, source: &Path) -> Result<(), PipelineError> {
        match (source.canonicalize(), self.target.canonicalize()) {
            (Ok(source), Ok(target)) if source.starts_with(&target) => {
                Err(ExportError::OwnScene { folder: self.target.clone() }.into())
            }
            _ => Ok(()),
        }
    }

    /// Writes an image, and its mask under the name that COLMAP looks for.
    pub fn write_image(&self, name: &str, image: &Resampled) -> Result<(), PipelineError> {
        let Resampled { colors, mask } = image;
        colors.write(&self.staging.path().join(IMAGES).join(name))?;
        if let Some(mask) = mask {
            let path = self.staging.path().join(MASKS).join(format!("{name}.png"));
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
        let path = |name: &str| self.staging.path().join(name);
        colmap::write(&path(MODEL), model, format)?;
        write_json(&path(SUMMARY), &views)?;
        let test: Vec<&str> = views.iter().filter(|v| v.is_test).map(|v| v.image.as_str()).collect();
        if !test.is_empty() {
            write_file(&path(MODEL).join(TEST_LIST), test.join("\n") + "\n")?;
        }
        if let Some(site) = site {
            write_json(&path(GEOREFERENCE), &crate::io::georeference(site))?;
        }
        let moved = || -> std::io::Result<()> {
            fs::create_dir_all(&self.target)?;
            for name in [SUMMARY, IMAGES, MASKS, SPARSE, GEOREFERENCE] {
                let (from, to) = (path(name), self.target.join(name));
                if to.is_dir() {
                    fs::remove_dir_all(&to)?;
                } else if to.exists() {
                    fs::remove_file(&to)?;
                }
                if from.exists() {
                    fs::rename(from, to)?;
                }
            }
            Ok(())
        };
        Ok(moved().map_err(|e| WriteError::new(&self.target, e))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
