//! COLMAP models: cameras, images and points in binary or text files
//! ([formats](https://colmap.github.io/format.html)).
//!
//! [`ColmapModel`] holds what the files hold, so that a model is the same after writing and reading. Files of rigs and
//! frames, which newer models have too, are not needed to read cameras and images.

mod binary;
mod bytes;
mod model;
mod project;
mod text;

pub use model::{ColmapCamera, ColmapImage, ColmapModel, ColmapObservation, ColmapPoint, Reprojection};
pub(super) use project::{drafts, is_model, is_project, project, read_project};

use super::error::PerspectiveError;
use crate::io::{WriteError, remove_if_there, vsi, write_atomically};
use std::io::{BufWriter, Write};
use std::path::Path;

/// How a model is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `cameras.bin`, `images.bin`, `points3D.bin`.
    Binary,
    /// `cameras.txt`, `images.txt`, `points3D.txt`.
    Text,
}

/// Names of the files of a model without their extensions.
const FILES: [&str; 3] = ["cameras", "images", "points3D"];
/// Files of newer models that refer to those of the model.
const OF_RIGS: [&str; 4] = ["rigs.bin", "frames.bin", "rigs.txt", "frames.txt"];

impl Format {
    fn extension(self) -> &'static str {
        match self {
            Self::Binary => "bin",
            Self::Text => "txt",
        }
    }
}

/// The format of the model in a folder, known by its file of cameras.
fn format_of(folder: &Path) -> Option<Format> {
    [Format::Binary, Format::Text]
        .into_iter()
        .find(|f| vsi::exists(&folder.join("cameras").with_extension(f.extension())))
}

/// Reads the model in a folder; binary files have precedence over text files. A model may have no file of points.
///
/// # Errors
/// [`PerspectiveError`] if a file is missing or damaged, or an image refers to a camera that does not exist.
pub fn read(folder: &Path) -> Result<ColmapModel, PerspectiveError> {
    let missing = |path, purpose| PerspectiveError::Missing {
        path,
        purpose,
        hint: "a COLMAP model is cameras, images and points3D, all .bin or all .txt",
    };
    let format = format_of(folder)
        .ok_or_else(|| missing(folder.join("cameras.bin"), "it holds the cameras of the COLMAP model"))?;
    let [cameras, images, points] = FILES.map(|f| folder.join(f).with_extension(format.extension()));
    if !vsi::exists(&images) {
        return Err(missing(images, "it holds the poses of the images, without which there are no views"));
    }
    let has_points = vsi::exists(&points);
    let model = match format {
        Format::Binary => ColmapModel {
            cameras: binary::cameras(&cameras)?,
            images: binary::images(&images)?,
            points: if has_points { binary::points(&points)? } else { Vec::new() },
        },
        Format::Text => ColmapModel {
            cameras: text::cameras(&cameras)?,
            images: text::images(&images)?,
            points: if has_points { text::points(&points)? } else { Vec::new() },
        },
    };
    model.check(&cameras, &images)?;
    Ok(model)
}

/// Writes a model into a folder, which is made if it does not exist. Files of an earlier model in the other format, and
/// its rigs and frames, are removed. COLMAP's reader of text files cuts the name of an image at its first blank; binary
/// files keep it.
///
/// # Errors
/// [`PerspectiveError::Write`] if a file cannot be written.
pub fn write(folder: &Path, model: &ColmapModel, format: Format) -> Result<(), PerspectiveError> {
    let [cameras, images, points] = FILES.map(|f| folder.join(f).with_extension(format.extension()));
    let file = |path: &Path, content: &dyn Fn(&mut dyn Write) -> std::io::Result<()>| {
        write_atomically(path, |temporary| {
            let failed = |e| WriteError::new(path, e);
            let mut out = BufWriter::new(std::fs::File::create(temporary).map_err(failed)?);
            content(&mut out).and_then(|()| out.flush()).map_err(failed)
        })
    };
    match format {
        Format::Binary => {
            file(&cameras, &|out| binary::write_cameras(out, &model.cameras))?;
            file(&images, &|out| binary::write_images(out, &model.images))?;
            file(&points, &|out| binary::write_points(out, &model.points))?;
        }
        Format::Text => {
            file(&cameras, &|out| text::write_cameras(out, &model.cameras))?;
            file(&images, &|out| text::write_images(out, &model.images))?;
            file(&points, &|out| text::write_points(out, &model.points))?;
        }
    }
    let other = if format == Format::Binary { Format::Text } else { Format::Binary };
    let stale = FILES.map(|f| folder.join(f).with_extension(other.extension()));
    for path in stale.into_iter().chain(OF_RIGS.map(|f| folder.join(f))) {
        remove_if_there(&path)?;
    }
    Ok(())
}
