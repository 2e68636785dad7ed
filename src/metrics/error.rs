//! Why a surface model cannot be scored.

use crate::frame::FrameError;
use crate::raster::RasterError;
use std::path::PathBuf;

/// Why a surface model cannot be scored.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum MetricsError {
    /// A raster could not be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Raster(#[from] RasterError),
    /// The two rasters' systems cannot be brought together.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// The truth has a geotransform, but none that heights in metres can be compared on.
    #[error("`{path}`: the truth cannot be used: {reason}")]
    #[diagnostic(help("`gdalwarp -t_srs EPSG:{epsg} -r bilinear` puts it on the prediction's map grid"))]
    TruthGrid {
        /// The truth.
        path: PathBuf,
        /// What is wrong with its grid.
        reason: String,
        /// EPSG code of the prediction.
        epsg: u32,
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
    /// The class raster is not on the truth's grid.
    #[error(
        "`{classes}` is {} x {} cells, the truth `{truth}` is {} x {}",
        found.0, found.1, expected.0, expected.1
    )]
    #[diagnostic(help("the class raster must lie on the truth's grid; --classes names another one"))]
    ClassSize {
        /// The class raster.
        classes: PathBuf,
        /// The truth.
        truth: PathBuf,
        /// Columns and rows of the class raster.
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
        "the prediction covers {extents} (west, south, east, north in metres); is one of them empty, elsewhere or \
         all water?"
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
