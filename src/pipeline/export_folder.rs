//! A folder that an export fills, which appears when it is complete.

use super::PipelineError;
use crate::export::ExportError;
use crate::io::WriteError;
use std::fs;
use std::path::{Path, PathBuf};

/// What was exported, by which a later export knows a folder whose contents it may replace.
pub(super) const SUMMARY: &str = "export.json";

/// Files beside their final folder, until all are complete.
pub(super) struct ExportFolder {
    target: PathBuf,
    staging: tempfile::TempDir,
}

impl ExportFolder {
    /// A folder that will appear at `target`, which must be empty or missing; with `overwrite` it replaces what an earlier
    /// export wrote there, which is known by [`SUMMARY`] and the file `mark`.
    pub fn new(target: &Path, mark: &str, overwrite: bool) -> Result<Self, PipelineError> {
        let failed = |e: std::io::Error| WriteError::new(target, e);
        let first = match fs::read_dir(target) {
            Ok(mut entries) => entries.next(),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(e) => return Err(failed(e).into()),
        };
        let is_known = || [SUMMARY, mark].iter().all(|name| target.join(name).exists());
        if first.is_some() && !(overwrite && is_known()) {
            return Err(ExportError::NotEmpty { folder: target.into() }.into());
        }
        let parent = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        fs::create_dir_all(parent).map_err(failed)?;
        let staging = tempfile::Builder::new().prefix(".satgs-").tempdir_in(parent).map_err(failed)?;
        Ok(Self { target: target.into(), staging })
    }

    /// Where the folder will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Where a file or folder is until then.
    pub fn path(&self, name: &str) -> PathBuf {
        self.staging.path().join(name)
    }

    /// Moves files and folders to their place, where they replace those of the same names, also if they were not made; other
    /// files there stay.
    pub fn finish(self, names: &[&str]) -> Result<(), PipelineError> {
        let moved = || -> std::io::Result<()> {
            fs::create_dir_all(&self.target)?;
            for name in names {
                let (from, to) = (self.path(name), self.target.join(name));
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
