//! Errors of priors.

use super::map::DepthKind;
use crate::io::{RasterError, ReadError, WriteError};
use std::path::PathBuf;

/// Why priors cannot be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum PriorError {
    /// The path is no folder.
    #[error("`{path}` is no folder with a file for each image")]
    #[diagnostic(help("expected NAME.npy, NAME.png, NAME.tif for an image called NAME.jpg"))]
    NoFolder {
        /// The path.
        path: PathBuf,
    },
    /// There is no file for any training view.
    #[error("`{folder}` has no file for any of the {views} training views, such as `{example}.npy`")]
    #[diagnostic(help("files are called as the images are, and end in .npy, .png, .tif or .tiff"))]
    NoFiles {
        /// The folder.
        folder: PathBuf,
        /// Number of training views.
        views: usize,
        /// Name of the first view.
        example: String,
    },
    /// A map has another shape than the image.
    #[error("`{path}` is {found}, expected {expected}")]
    #[diagnostic(help("a map may be smaller or larger than its image, but must show all of it"))]
    Shape {
        /// The file.
        path: PathBuf,
        /// Its shape.
        found: String,
        /// What fits the image.
        expected: String,
    },
    /// A map has no values to compare with.
    #[error("`{path}` {fault}")]
    #[diagnostic(help("is the map complete? leave its file out to train this view without it"))]
    Empty {
        /// The file.
        path: PathBuf,
        /// What is wrong with its values.
        fault: &'static str,
    },
    /// Depths and points of the scene contradict each other.
    #[error(
        "the values of `{folder}` are said to be {kind}, but grow with the opposite of it: their correlation with the \
         scene's points is {correlation:.2}"
    )]
    #[diagnostic(help(
        "--prior-kind disparity is of values that are larger where the scene is nearer, relative and metric of those that \
         are larger where it is farther"
    ))]
    Opposite {
        /// The folder.
        folder: PathBuf,
        /// What the values are said to be.
        kind: DepthKind,
        /// The median of the views' correlations.
        correlation: f64,
    },
    /// Depths and points of the scene have nothing to do with each other.
    #[error(
        "the values of `{folder}` do not follow the scene: their correlation with its points is {correlation:.2}, as the \
         median of {views} views"
    )]
    #[diagnostic(help("are the maps of another scene, or turned or cut otherwise than the images?"))]
    OtherScene {
        /// The folder.
        folder: PathBuf,
        /// The median of the views' correlations.
        correlation: f64,
        /// Number of views.
        views: usize,
    },
    /// Nothing says what the values are.
    #[error("nothing says what the values of `{folder}` are, and the scene has too few points to see it")]
    #[diagnostic(help("give --prior-kind metric, relative or disparity"))]
    NoKind {
        /// The folder.
        folder: PathBuf,
    },
    /// The depths of no view can be aligned with the points of the scene.
    #[error("the depths of no view can be aligned with the points of the scene: `{view}`: {reason}")]
    #[diagnostic(help("train without --start, or reconstruct the images with more points"))]
    Unaligned {
        /// The first view.
        view: String,
        /// Why its depths cannot be aligned.
        reason: String,
    },
    /// No convention of axes makes normals and points agree.
    #[error(
        "the normals of `{folder}` do not fit the scene's points: the mean cosine is {best:.2} with the best choice of \
         signs of their axes, and {second:.2} with the next one"
    )]
    #[diagnostic(help(
        "normals are in camera axes (right, down, forward), each with either sign; are they of another scene?"
    ))]
    Normals {
        /// The folder.
        folder: PathBuf,
        /// Mean cosine with the best signs.
        best: f64,
        /// Mean cosine with the second best signs.
        second: f64,
    },
    /// A file cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Read(#[from] ReadError),
    /// A raster cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// A file cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}
