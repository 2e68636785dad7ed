//! Why a surface model cannot be scored.

use crate::frame::FrameError;
use crate::io::{CloudError, RasterError, VectorError, VerticalError};
use std::path::PathBuf;

/// Why a surface model cannot be scored.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum MetricsError {
    /// A raster could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// The mask is no vector file that can be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Vector(#[from] VectorError),
    /// A point cloud is empty or damaged.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cloud(#[from] CloudError),
    /// The two rasters' systems cannot be brought together.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// The truth has a geotransform, but none that heights in metres can be compared on.
    #[error("`{path}`: the truth cannot be used: {reason}")]
    #[diagnostic(help("`gdalwarp -t_srs {crs} -r bilinear` puts it on the prediction's map grid"))]
    TruthGrid {
        /// The truth.
        path: PathBuf,
        /// What is wrong with its grid.
        reason: &'static str,
        /// The prediction's CRS, as `gdalwarp` takes it; a placeholder before it is known.
        crs: String,
    },
    /// The truth has no georeference, and its text file is not there.
    #[error("`{path}` has no georeference and `{txt}` does not exist")]
    #[diagnostic(help(
        "DFC2019's truth needs the .txt beside the .tif: easting and northing of the lower-left corner, size in \
         cells, resolution in metres"
    ))]
    NoPlace {
        /// The truth.
        path: PathBuf,
        /// The text file that was looked for.
        txt: PathBuf,
    },
    /// The text file beside the truth does not say where it lies.
    #[error("`{txt}`: {reason}")]
    #[diagnostic(help(
        "expected four numbers: easting and northing of the lower-left corner in metres, size in cells, \
         resolution in metres"
    ))]
    Txt {
        /// The text file.
        txt: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// Heights count from something whose height above the ellipsoid is not known.
    #[error("`{path}`: its heights count from `{from}`, and {reason}")]
    #[diagnostic(help(
        "--vertical (of dsm-eval and run: --truth-vertical) says what they are to be taken for: `ellipsoid`, EGM84, EGM96, \
         EGM2008 or a geoid's grid (.gtx, .tif of PROJ)"
    ))]
    VerticalReference {
        /// The file.
        path: PathBuf,
        /// What it says.
        from: String,
        /// Why that cannot be used.
        reason: Box<VerticalError>,
    },
    /// It is not known where a point cloud lies.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help(
        "`satgs dsm-eval --truth-crs EPSG` says which map projection in metres its coordinates are in; `pdal translate` with \
         filters.reprojection makes others one"
    ))]
    CloudCrs {
        /// The point cloud.
        path: PathBuf,
        /// What is wrong with its CRS.
        reason: String,
    },
    /// The geoid's grid does not cover a file.
    #[error("the geoid's grid does not cover `{path}`")]
    #[diagnostic(help(
        "--vertical or --truth-vertical takes a grid of the place, as those of PROJ's data are"
    ))]
    GeoidElsewhere {
        /// The file.
        path: PathBuf,
    },
    /// The mask covers nothing of the truth.
    #[error("no cell of the truth `{truth}` is inside of the mask `{mask}`")]
    #[diagnostic(help("do both lie in the same place? a raster mask is not 0 inside"))]
    EmptyMask {
        /// The mask.
        mask: PathBuf,
        /// The truth.
        truth: PathBuf,
    },
    /// Classes or mask are not on the truth's grid.
    #[error(
        "`{path}` ({what}, {} x {} cells) does not lie on the grid of the truth `{truth}`, {} x {} cells",
        found.0, found.1, expected.0, expected.1
    )]
    #[diagnostic(help(
        "`gdalwarp -te -tr -r near` puts a raster on another's grid; --classes and --mask name other ones"
    ))]
    OtherGrid {
        /// The raster.
        path: PathBuf,
        /// What it is for.
        what: &'static str,
        /// The truth.
        truth: PathBuf,
        /// Its columns and rows.
        found: (usize, usize),
        /// Columns and rows of the truth.
        expected: (usize, usize),
    },
    /// Too few cells hold both a prediction and a truth.
    #[error(
        "`{prediction}` and `{truth}` do not overlap: {common} common cells, {needed} are needed ({predicted} \
         predicted cells on the truth's grid, {land} cells of land)"
    )]
    #[diagnostic(help(
        "the prediction covers {extents} (west, south, east, north in metres; a truth without a CRS is taken to be in the \
         prediction's); is one of them empty, elsewhere or all water?"
    ))]
    NoOverlap {
        /// The prediction.
        prediction: PathBuf,
        /// The truth.
        truth: PathBuf,
        /// Cells with both.
        common: usize,
        /// Cells that are needed.
        needed: usize,
        /// Valid predicted cells on the truth's grid.
        predicted: usize,
        /// Truth cells that are valid and not water.
        land: usize,
        /// Bounds and CRS of both, as text.
        extents: String,
    },
}
