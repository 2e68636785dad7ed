//! Why a scene could not be adjusted.

use crate::io::{CloudError, RasterError, WriteError};
use crate::progress::Interrupted;
use crate::rpc::formats::FormatError;
use crate::scene::SceneError;
use std::path::PathBuf;

/// Why a scene could not be adjusted.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum BundleError {
    /// The scene itself is no good.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Scene(#[from] SceneError),
    /// An image could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// The point cloud of sparse points could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cloud(#[from] CloudError),
    /// A file could not be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// A corrected RPC could not be read back.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Format(#[from] FormatError),
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
    /// Heights in the wrong order.
    #[error("the height range {low_m} to {high_m} m is empty")]
    #[diagnostic(help("--height-range LOW,HIGH in metres above the ellipsoid, LOW below HIGH"))]
    Heights {
        /// Lowest.
        low_m: f64,
        /// Highest.
        high_m: f64,
    },
    /// Too few views have anything to match.
    #[error("{usable} of {all} views can be matched, two are needed; left out: {left_out}")]
    #[diagnostic(help("are the images constant, all nodata, or of different places?"))]
    TooFewViews {
        /// Views with keypoints.
        usable: usize,
        /// Views in the scene.
        all: usize,
        /// The others, by name and reason.
        left_out: String,
    },
    /// Matches do not tie the views together.
    #[error("the matches do not connect the views: {components}")]
    #[diagnostic(help("do the views show the same place? a wider --height-range may help"))]
    NotConnected {
        /// Groups of views that are connected among themselves.
        components: String,
    },
    /// Views from the same direction.
    #[error("no two views differ by {needed_deg}° in direction: heights cannot be measured")]
    #[diagnostic(help("`satgs info` lists the convergence angles"))]
    NoBaseline {
        /// Smallest useful angle.
        needed_deg: f64,
    },
    /// The normal equations have no solution.
    #[error("the adjustment did not converge: {reason}")]
    #[diagnostic(code(satgs::failed))]
    Solver {
        /// The solver's words.
        reason: String,
    },
    /// A corrected camera is no RPC.
    #[error("view `{view}`: no RPC stands for its correction: {reason}")]
    #[diagnostic(code(satgs::failed), help("--model shift needs no refit"))]
    Refit {
        /// The view.
        view: String,
        /// The fit's words.
        reason: String,
    },
    /// Ground control that cannot be read.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help(
        "columns: lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px; a line for each image of a point"
    ))]
    Control {
        /// The file.
        path: PathBuf,
        /// What is wrong, and where.
        reason: String,
    },
    /// A point of ground control that cannot be where an image shows it.
    #[error("`{path}`: line {line}: {reason}")]
    #[diagnostic(help("{cause}"))]
    ControlPlace {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
        /// What is likely to have caused it.
        cause: String,
    },
    /// Ground control of an image that the scene does not have.
    #[error("ground control names the image `{image}`, which is not in the scene")]
    #[diagnostic(help("`satgs info SCENE` lists its views"))]
    ControlImage {
        /// The image.
        image: String,
    },
    /// A reference view that is not there to refer to.
    #[error("reference view `{view}` {reason}")]
    #[diagnostic(help("`satgs info SCENE` lists the views"))]
    Reference {
        /// The view.
        view: String,
        /// What is wrong with it.
        reason: String,
    },
    /// Sparse points cannot be written or read.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help("`satgs ba SCENE -o RUN --overwrite` makes it anew"))]
    Points {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A view of the scene has no corrected camera.
    #[error("view `{view}` has no corrected camera in `{folder}`")]
    #[diagnostic(help("`satgs ba SCENE -o RUN --overwrite` makes it anew"))]
    NoCamera {
        /// The view.
        view: String,
        /// Where it was looked for.
        folder: PathBuf,
    },
}
