//! Errors of perspective scenes.

use super::pose_finding::PoseFinding;
use crate::fault::ErrorKind;
use crate::frame::FrameError;
use crate::io::{RasterError, ReadError, WriteError};
use std::path::{Path, PathBuf};

/// Why a perspective scene, its images or its depth maps cannot be read, or a COLMAP model not be written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum PerspectiveError {
    /// The path is none of the known layouts.
    #[error("`{path}` is no perspective scene{found}")]
    #[diagnostic(help("{next_step}"))]
    NoLayout {
        /// The given path.
        path: PathBuf,
        /// What it holds instead, as a clause after a colon; empty for nothing that is known.
        found: String,
        /// What to do about it.
        next_step: String,
    },
    /// A perspective scene was given where a satellite scene is needed.
    #[error("`{path}` is a perspective scene ({layout}), which this command cannot use")]
    #[diagnostic(help(
        "this command needs satellite images with RPC cameras; `satgs info SCENE` shows a perspective scene"
    ))]
    NotSatellite {
        /// The scene.
        path: PathBuf,
        /// How its files are arranged.
        layout: &'static str,
    },
    /// A file has a value that cannot be.
    #[error("`{path}`: {field} is {found}, expected {expected}")]
    #[diagnostic(help("is the file complete, and of the format that its name says?"))]
    Field {
        /// The file.
        path: PathBuf,
        /// Name and place of the value.
        field: String,
        /// The value.
        found: String,
        /// What it must be.
        expected: String,
    },
    /// A binary file ends too early.
    #[error("`{path}` ends in {field}: {needed} more bytes are needed, {left} are left")]
    #[diagnostic(help("is the file complete? copy it again, or write the model again"))]
    CutShort {
        /// The file.
        path: PathBuf,
        /// The value that is not complete.
        field: String,
        /// Bytes that the value needs at least.
        needed: u64,
        /// Bytes that are left in the file.
        left: u64,
    },
    /// A file of the scene is missing.
    #[error("`{path}` is missing: {purpose}")]
    #[diagnostic(help("{hint}"))]
    Missing {
        /// The file or folder.
        path: PathBuf,
        /// What it is needed for.
        purpose: &'static str,
        /// What to do about it.
        hint: &'static str,
    },
    /// Images of the scene are missing.
    #[error("{missing} of {of} images are missing, the first is `{first}`")]
    #[diagnostic(help("{hint}"))]
    NoImages {
        /// Number of missing images.
        missing: usize,
        /// Number of images of the scene.
        of: usize,
        /// The first missing one.
        first: PathBuf,
        /// Where images are looked for.
        hint: &'static str,
    },
    /// A camera model is not one of those that can be undistorted.
    #[error("`{path}`: {field} has the camera model {found}, which is not known")]
    #[diagnostic(help(
        "known are COLMAP's models 0 to 10: SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, \
         FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE; `colmap image_undistorter` \
         writes images of pinhole cameras"
    ))]
    Model {
        /// The file.
        path: PathBuf,
        /// Which camera.
        field: String,
        /// Number or name of the model.
        found: String,
    },
    /// The size of an image, a mask or a depth map is not the expected one.
    #[error("`{path}` is {width} x {height} pixels, {of} is {expected_width} x {expected_height}")]
    #[diagnostic(help("{hint}"))]
    Size {
        /// The raster.
        path: PathBuf,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// What it is compared with.
        of: &'static str,
        /// Expected columns.
        expected_width: usize,
        /// Expected rows.
        expected_height: usize,
        /// What to do about it.
        hint: &'static str,
    },
    /// Two images would give views of the same name.
    #[error("`{first}` and `{second}` give views of the same name")]
    #[diagnostic(help(
        "the name of a view is the name of its image without the extension: rename one of them"
    ))]
    SameName {
        /// One image.
        first: String,
        /// The other.
        second: String,
    },
    /// A list names a view that does not exist.
    #[error("`{path}` names the view `{name}`, which does not exist")]
    #[diagnostic(help(
        "a line is the name of an image, with or without its extension; the first view is `{first}`"
    ))]
    UnknownView {
        /// The list.
        path: PathBuf,
        /// The name in the list.
        name: String,
        /// Name of the first view of the scene.
        first: String,
    },
    /// The scene has no view that can be used.
    #[error("`{path}` has no views")]
    #[diagnostic(help("{hint}"))]
    NoViews {
        /// The scene.
        path: PathBuf,
        /// What a view needs.
        hint: &'static str,
    },
    /// Every image of the scene is left out.
    #[error("`{path}`: all {images} images are left out; `{first}`: {reason}")]
    #[diagnostic(help("a view is an image with its camera and pose"))]
    AllLeftOut {
        /// The scene.
        path: PathBuf,
        /// Number of images.
        images: usize,
        /// The first.
        first: String,
        /// Why it is left out.
        reason: String,
    },
    /// Positions do not determine the georeference.
    #[error("`{path}` does not determine where the scene lies: {reason}")]
    #[diagnostic(help(
        "a similarity needs three images whose positions are farther from a line than their errors; a list has the line \
         `EPSG:CODE`, then `image easting northing height` for each image; a similarity that is known can be given as JSON"
    ))]
    Georeference {
        /// The list, or the scene whose photographs were asked.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// A number of an option is not one of those that are possible.
    #[error("downsampling by {found} is not possible")]
    #[diagnostic(help("1, 2, 4 and 8 are"))]
    Downsampling {
        /// The given number.
        found: u32,
    },
    /// No pixel of an image can be used.
    #[error("no pixel of `{image}` can be used: {reason}")]
    #[diagnostic(help(
        "a mask is black where its image is not to be used; leave the image out of the scene if there is nothing to use in it"
    ))]
    NoPixels {
        /// The image.
        image: PathBuf,
        /// What hides the pixels.
        reason: String,
    },
    /// The photographs contradict the poses of the scene.
    #[error("`{path}`: {finding}")]
    #[diagnostic(help("{next_step}"))]
    Contradicted {
        /// The scene.
        path: PathBuf,
        /// What they say.
        finding: PoseFinding,
        /// What to do about it.
        next_step: &'static str,
    },
    /// A view has no depth map.
    #[error("view `{view}` has no depth map")]
    #[diagnostic(help(
        "depth maps come with RGB-D folders, LEVIR-NVS, ScanNet++ (dslr/render_depth) and `depth_file_path` or `depth_path` in a \
         transforms.json"
    ))]
    NoDepth {
        /// The view.
        view: String,
    },
    /// A text or JSON file cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Read(#[from] ReadError),
    /// An image, mask or depth map cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// A file cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// The place cannot be mapped.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Place(#[from] FrameError),
}

impl PerspectiveError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

impl PerspectiveError {
    /// The error of a value in a file.
    pub(super) fn field(
        path: &Path,
        field: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        Self::Field { path: path.into(), field: field.into(), found: found.into(), expected: expected.into() }
    }
}
