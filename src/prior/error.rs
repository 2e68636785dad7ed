//! Errors of priors.

use super::map::{DepthKind, PriorContent};
use crate::fault::ErrorKind;
use crate::io::{RasterError, ReadError, WriteError};
use crate::nn::onnx::OnnxError;
use crate::perspective::PerspectiveError;
use std::path::PathBuf;
use std::process::ExitStatus;

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
    #[diagnostic(help("files have the names of the images, and end in .npy, .png, .tif or .tiff"))]
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
        "`{folder}` is stated to hold {kind}, but its values grow in the opposite direction: their correlation with the \
         scene's points is {correlation:.2}"
    )]
    #[diagnostic(help(
        "use --prior-kind disparity if values are larger where the scene is nearer, relative or metric if they are larger where it \
         is farther"
    ))]
    Opposite {
        /// The folder.
        folder: PathBuf,
        /// What the values are stated to be.
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
        "the normals of `{folder}` do not fit the scene's points: in the axes in which they agree best, the median angle between \
         both is {angle_deg:.0} degrees"
    )]
    #[diagnostic(help(
        "the axes of the camera and of the scene are tried, in any order and with either sign; are the normals of another scene, or \
         turned or cut otherwise than the images?"
    ))]
    Normals {
        /// The folder.
        folder: PathBuf,
        /// The median angle.
        angle_deg: f64,
    },
    /// A text names no command that fills pictures.
    #[error("`{text}` does not name {{rgb}}, {{mask}} and {{out}}")]
    #[diagnostic(help(
        "a command gets a picture, a mask of its holes and the file to write: 'python3 inpaint.py {{rgb}} {{mask}} {{out}}'"
    ))]
    NoInpainter {
        /// The text.
        text: String,
    },
    /// A command has written a picture that cannot be used.
    #[error("the picture that `{command}` has written {fault}")]
    #[diagnostic(help("{{out}} is a PNG of the size of {{rgb}} with red, green and blue"))]
    Inpainted {
        /// The command.
        command: String,
        /// What is wrong with the picture.
        fault: String,
    },
    /// A text names no source of priors.
    #[error(
        "`{text}` is neither an existing folder, nor an existing file that ends in .onnx, nor a command with {{image}} and {{out}}"
    )]
    #[diagnostic(help(
        "a folder has a map for each image; a file .onnx is a network; a command is called for each image: 'python3 depth.py \
         {{image}} {{out}}'"
    ))]
    NoSource {
        /// The text.
        text: String,
    },
    /// A command has an open quotation mark, or does not name its program.
    #[error(
        "`{text}` cannot be split into words as a shell does: a quotation mark is open, or a backslash at its end"
    )]
    #[diagnostic(help("each quotation mark needs a second one"))]
    Words {
        /// The command.
        text: String,
    },
    /// A network cannot be read or evaluated.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Network(#[from] OnnxError),
    /// The first output of a network is no map of the whole picture.
    #[error(
        "`{path}` gives {found} for a picture of {columns} x {rows} pixels; expected {content} of the whole picture, f32 {expected}"
    )]
    #[diagnostic(help(
        "the first output of the graph is used; other networks can be called by a command, or write a folder"
    ))]
    Output {
        /// The file.
        path: PathBuf,
        /// Type and shape of the output.
        found: String,
        /// What it is to be.
        content: PriorContent,
        /// Its shapes.
        expected: &'static str,
        /// Columns of the picture.
        columns: usize,
        /// Rows of the picture.
        rows: usize,
    },
    /// The program of a command cannot be started.
    #[error("`{command}`: its program `{program}` cannot be started: {cause}")]
    #[diagnostic(help(
        "is it installed, and on the PATH? a script that is not executable is started by its interpreter: 'sh \
         depth.sh {{image}} {{out}}'"
    ))]
    CommandStart {
        /// The command.
        command: String,
        /// Its first word.
        program: String,
        /// Error of the system.
        cause: std::io::Error,
    },
    /// A command ends with an error.
    #[error("`{command}` failed for `{image}` ({status}): {said}")]
    #[diagnostic(help("what was made so far is kept; the same command continues with the next image"))]
    CommandFailed {
        /// The command.
        command: String,
        /// The image.
        image: PathBuf,
        /// How it ended.
        status: ExitStatus,
        /// The last lines of its standard error.
        said: String,
    },
    /// A command takes too long.
    #[error("`{command}` was stopped after {limit_s} s at `{image}`: {said}")]
    #[diagnostic(help(
        "does it wait for something? a program that needs longer for an image can write a folder of maps by itself"
    ))]
    CommandTime {
        /// The command.
        command: String,
        /// The image.
        image: PathBuf,
        /// The time limit, seconds.
        limit_s: f64,
        /// The last lines of its standard error.
        said: String,
    },
    /// A command has not written its map.
    #[error("`{command}` ended without an error but has not written the map of `{image}`: {said}")]
    #[diagnostic(help(
        "it must write the file that {{out}} stands for, NAME.npy; `{{out}}.png` and `{{out}}.tif` are called so"
    ))]
    CommandSilent {
        /// The command.
        command: String,
        /// The image.
        image: PathBuf,
        /// The last lines of its standard error.
        said: String,
    },
    /// A map that was made cannot be used.
    #[error("the map that `{maker}` gives for `{image}` {fault}")]
    #[diagnostic(help(
        "a map shows all of its image in the same proportion of sides; see docs/guide/priors.md"
    ))]
    Unusable {
        /// The network or the command.
        maker: String,
        /// The image.
        image: PathBuf,
        /// What is wrong with it.
        fault: String,
    },
    /// Matching gives no normals.
    #[error("matching of images (`stereo`) gives depths, no normals")]
    #[diagnostic(help("a network, a command or a folder gives normals"))]
    NoNormals,
    /// A file would be replaced.
    #[error("`{path}` exists, and was not made from the same image by `{maker}`")]
    #[diagnostic(help("--overwrite replaces it, another output keeps both"))]
    OtherMap {
        /// The file.
        path: PathBuf,
        /// The network or the command.
        maker: String,
    },
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error("interrupted after {made} of {total} maps")]
    #[diagnostic(help("what is done is kept: the same command continues"))]
    Interrupted {
        /// Maps that are made.
        made: usize,
        /// Maps that were to be made.
        total: usize,
    },
    /// An image cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Image(#[from] PerspectiveError),
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

impl PriorError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Network(e) => e.kind(),
            Self::CommandFailed { .. } | Self::CommandTime { .. } => ErrorKind::Failed,
            Self::Interrupted { .. } => ErrorKind::Interrupted,
            Self::Image(e) => e.kind(),
            Self::Raster(e) => e.kind(),
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

impl PriorError {
    /// Whether the maps themselves cannot be used: there are none, or they contradict the scene.
    #[must_use]
    pub fn is_of_maps(&self) -> bool {
        matches!(
            self,
            Self::Unusable { .. } | Self::NoFiles { .. } | Self::OtherScene { .. } | Self::Opposite { .. }
        )
    }
}
