//! One view of a list.

use super::sidecar::Sidecars;
use super::source::{files_beside, no_rpc, view};
use super::{Role, SceneError, Sun, View};
use crate::io::vsi;
use crate::rpc::formats::iso_date;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// One view of a list.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Entry {
    pub image: PathBuf,
    /// RPC file; without it, the RPC is searched beside and in the image.
    pub rpc: Option<PathBuf>,
    pub name: Option<String>,
    /// Azimuth and elevation, degrees.
    pub sun: Option<[f64; 2]>,
    /// ISO 8601.
    pub acquired: Option<String>,
    /// Raster of the size of the image, 0 at pixels without valid data.
    pub mask: Option<PathBuf>,
    #[serde(default)]
    pub test: bool,
}

impl Entry {
    /// Reads the view. `list` is the file that names it, for messages; paths are relative to `folder`.
    pub fn view(
        self,
        list: &Path,
        folder: &Path,
        trust_rpc: bool,
        warnings: &mut Vec<String>,
    ) -> Result<View, SceneError> {
        let wrong = |reason: String| SceneError::List { path: list.into(), reason };
        for file in [Some(&self.image), self.rpc.as_ref(), self.mask.as_ref()].into_iter().flatten() {
            let text = file.to_string_lossy();
            if let Some((scheme, _)) = text.split_once("://")
                && !vsi::is_virtual(file)
                && vsi::from_url(&text).is_none()
            {
                return Err(wrong(format!(
                    "`{text}`: URLs of `{scheme}` cannot be read; known are https, http, ftp, s3, gs, az and file"
                )));
            }
        }
        let image = vsi::join(folder, &self.image);
        let sidecars = match &self.rpc {
            Some(rpc) => Sidecars::with_camera(vsi::join(folder, rpc), &image, &files_beside(&image)?),
            None => Sidecars::of(&image, &files_beside(&image)?),
        };
        let mut view = view(&image, &sidecars, trust_rpc, warnings)?.ok_or_else(|| no_rpc(&image))?;
        if let Some([azimuth, elevation]) = self.sun {
            let sun = Sun::new(azimuth, elevation);
            view.sun = Some(sun.ok_or_else(|| {
                wrong(format!("sun = [{azimuth}, {elevation}] is not an azimuth and an elevation in degrees"))
            })?);
        }
        view.name = self.name.unwrap_or(view.name);
        if view.name.is_empty() || view.name.contains(['/', '\\']) {
            return Err(wrong(format!("the name `{}` cannot be used as a file name", view.name)));
        }
        if let Some(time) = self.acquired {
            let date = iso_date(&time).ok_or_else(|| wrong(format!("`{time}` is not an ISO 8601 date")));
            view.acquired = Some(date?);
        }
        view.role = if self.test { Role::Test } else { Role::Train };
        if let Some(mask) = self.mask {
            view.set_mask(vsi::join(folder, &mask))?;
        }
        Ok(view)
    }
}
