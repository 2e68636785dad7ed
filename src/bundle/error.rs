//! Errors of bundle adjustment.

use crate::fault::ErrorKind;
use crate::io::{CloudError, RasterError, WriteError};
use crate::progress::Interrupted;
use crate::rpc::formats::FormatError;
use crate::scene::SceneError;
use std::path::PathBuf;

/// Why a scene could not be adjusted.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum BundleError {
    /// The scene cannot be used.
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
    /// The range of heights is empty.
    #[error("the height range {low_m} to {high_m} m is empty")]
    #[diagnostic(help("--height-range LOW,HIGH in metres above the ellipsoid, LOW below HIGH"))]
    Heights {
        /// Lowest height.
        low_m: f64,
        /// Highest height.
        high_m: f64,
    },
    /// Fewer than two views can be matched.
    #[error("{usable} of {all} views can be matched, two are needed; left out: {left_out}")]
    #[diagnostic(help("are the images constant, all nodata, or of different places?"))]
    TooFewViews {
        /// Number of views with enough keypoints.
        usable: usize,
        /// Number of views in the scene.
        all: usize,
        /// Names of the other views with the reasons.
        left_out: String,
    },
    /// The matches do not connect all views.
    #[error("the matches do not connect the views: {components}")]
    #[diagnostic(help("do the views show the same place? {hint}"))]
    NotConnected {
        /// Groups of connected views.
        components: String,
        /// What the range of heights has to do with it.
        hint: String,
    },
    /// The views are connected, but no match agrees with the cameras.
    #[error("no match agrees with the cameras")]
    #[diagnostic(help("{hint}"))]
    NoTracks {
        /// What ground control and the range of heights have to do with it.
        hint: String,
    },
    /// No cell of a large scene's ground gave tie points.
    #[error("none of the {cells} cells of the ground has tie points: {reasons}")]
    #[diagnostic(help("do the views show the same place without clouds? {hint}"))]
    NoCell {
        /// Number of cells.
        cells: usize,
        /// The cells with the reasons.
        reasons: String,
        /// What the range of heights has to do with it.
        hint: String,
    },
    /// No two views show the same ground.
    #[error(
        "no two views share {needed_percent} % of their ground at any height from {low_m:.0} to {high_m:.0} m: \
         `{first}` and `{second}` share most, {percent:.1} %"
    )]
    #[diagnostic(help(
        "`satgs info` shows the footprints of the views; --height-range or --dem gives the heights of the ground"
    ))]
    NoOverlap {
        /// The two views that share most.
        first: String,
        /// The other one.
        second: String,
        /// What they share, percent of the smaller footprint.
        percent: f64,
        /// What is needed.
        needed_percent: f64,
        /// Lowest height that was examined.
        low_m: f64,
        /// Highest height that was examined.
        high_m: f64,
    },
    /// All views see the scene from nearly the same direction.
    #[error(
        "no two views differ by {needed_deg}° in direction, at most by {widest_deg:.2}°: heights cannot be measured"
    )]
    #[diagnostic(help("`satgs info` lists the convergence angles"))]
    NoBaseline {
        /// Smallest sufficient angle.
        needed_deg: f64,
        /// Largest angle between views that overlap.
        widest_deg: f64,
    },
    /// The directions of all views that overlap are too far apart.
    #[error(
        "all views that overlap differ by more than {most_deg}° in direction, at least by {narrowest_deg:.1}°: they cannot be matched"
    )]
    #[diagnostic(help("add views from directions between; `satgs info` lists the convergence angles"))]
    TooOblique {
        /// Largest angle of views that are matched.
        most_deg: f64,
        /// Smallest angle between views that overlap.
        narrowest_deg: f64,
    },
    /// The solution failed.
    #[error("the adjustment did not converge: {reason}")]
    Solver {
        /// Message of the solver.
        reason: String,
    },
    /// A corrected camera cannot be written as an RPC.
    #[error("view `{view}`: the corrected camera cannot be written as an RPC: {reason}")]
    #[diagnostic(help("`--model shift` needs no fit"))]
    Refit {
        /// Name of the view.
        view: String,
        /// Message of the fit.
        reason: String,
    },
    /// The ground control file cannot be read.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help(
        "columns: lon,lat,h,image,col,row,sigma_xy_m,sigma_h_m,sigma_px; a line for each image of a point"
    ))]
    Control {
        /// The file.
        path: PathBuf,
        /// What is wrong, and in which line.
        reason: String,
    },
    /// A ground control point contradicts the delivered camera.
    #[error("`{path}`: line {line}: {reason}")]
    #[diagnostic(help("{cause}"))]
    ControlPlace {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        line: usize,
        /// What is wrong with it.
        reason: String,
        /// Likely cause.
        cause: String,
    },
    /// The ground control names an image that is not in the scene.
    #[error("ground control names the image `{image}`, which is not in the scene")]
    #[diagnostic(help("`satgs info SCENE` lists its views"))]
    ControlImage {
        /// Name of the image.
        image: String,
    },
    /// A reference view is not available.
    #[error("reference view `{view}` {reason}")]
    #[diagnostic(help("`satgs info SCENE` lists the views"))]
    Reference {
        /// Name of the view.
        view: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The files of an adjustment cannot be written or read.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help("`satgs ba SCENE -o RUN --overwrite` writes it again"))]
    Points {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// The adjustment has no camera of a view.
    #[error("view `{view}` has no corrected camera in `{folder}`")]
    #[diagnostic(help("`satgs ba SCENE -o RUN --overwrite` writes it again"))]
    NoCamera {
        /// Name of the view.
        view: String,
        /// Folder of the corrected cameras.
        folder: PathBuf,
    },
}

impl BundleError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Scene(e) => e.kind(),
            Self::Raster(e) => e.kind(),
            Self::Write(e) => e.kind(),
            Self::Interrupted(_) => ErrorKind::Interrupted,
            Self::Solver { .. } | Self::Refit { .. } => ErrorKind::Failed,
            _ => ErrorKind::Input,
        }
    }
}

/// A range of heights from which on a narrower one helps more than a wider one, metres: lines along which matches are searched
/// become so long that many wrong ones lie on them. Mountains have smaller ranges.
const WIDE_RANGE_M: f64 = 2000.0;

/// What the range in which heights are searched has to do with matches that fail.
pub(super) fn height_hint((low_m, high_m): (f64, f64)) -> String {
    let change = if high_m - low_m > WIDE_RANGE_M {
        "a narrower --height-range LOW,HIGH helps"
    } else {
        "a wider --height-range LOW,HIGH helps if the ground lies outside"
    };
    format!("heights are searched from {low_m:.0} to {high_m:.0} m: {change}")
}
