//! Why a surface model cannot be scored.

use crate::fault::ErrorKind;
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
    /// The vector file of the mask cannot be used.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Vector(#[from] VectorError),
    /// A point cloud is empty or damaged.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Cloud(#[from] CloudError),
    /// There is no transform between the coordinate systems of the two rasters.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Frame(#[from] FrameError),
    /// The truth has no north-up map grid in metres.
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
    /// The truth has no georeference, and its text file does not exist.
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
    /// The text file beside the truth is invalid.
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
    /// The vertical reference of the heights is not known, or cannot be used.
    #[error("`{path}`: the vertical reference of its heights is `{from}`, and {reason}")]
    #[diagnostic(help(
        "--vertical (of dsm-eval and run: --truth-vertical) sets the vertical reference: `ellipsoid`, EGM84, EGM96, \
         EGM2008 or a geoid's grid (.gtx, .tif of PROJ)"
    ))]
    VerticalReference {
        /// The file.
        path: PathBuf,
        /// The vertical reference that the file states.
        from: String,
        /// Why that cannot be used.
        reason: Box<VerticalError>,
    },
    /// The CRS of a point cloud is not known, or not in metres.
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
        "--vertical or --truth-vertical takes a grid that covers the place, such as those in PROJ's data"
    ))]
    GeoidElsewhere {
        /// The file.
        path: PathBuf,
    },
    /// The mask contains no cell of the truth.
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
    /// A mesh to be scored, or its reference, has no surface.
    #[error(
        "a mesh of {triangles} triangles cannot be compared with one of {reference_triangles}: one has no area"
    )]
    #[diagnostic(help("both need triangles"))]
    EmptyMesh {
        /// Triangles of the one.
        triangles: usize,
        /// Triangles of the other.
        reference_triangles: usize,
    },
    /// A mesh is in another CRS than what it is compared with.
    #[error("`{path}` is in EPSG:{found}, what it is compared with in EPSG:{expected}")]
    #[diagnostic(help("meshes are compared on one map; its georeference is in the .georef.json beside it"))]
    MeshCrs {
        /// The mesh.
        path: PathBuf,
        /// EPSG code of the mesh.
        found: u32,
        /// EPSG code of the other mesh or the views.
        expected: u32,
    },
    /// Two meshes have no place in common.
    #[error("`{mesh}` and `{reference}` do not overlap: {extents}")]
    #[diagnostic(help(
        "are both in the same frame and unit? --align and --views bring a mesh to its reference by the cameras of both"
    ))]
    MeshesApart {
        /// The mesh.
        mesh: PathBuf,
        /// The reference.
        reference: PathBuf,
        /// Lowest and highest coordinates of both, as text.
        extents: String,
    },
    /// The views see no part of a mesh.
    #[error("the {views} views see no part of `{path}`")]
    #[diagnostic(help("--views is a run or scene in the frame of the reference"))]
    NotSeen {
        /// The mesh.
        path: PathBuf,
        /// Number of views.
        views: usize,
    },
    /// An alignment lacks the cameras of the reference.
    #[error("--align needs the cameras of the reference too")]
    #[diagnostic(help(
        "--views names a run or scene in the frame of the reference, --align the one in the frame of the mesh, with images \
         of the same names"
    ))]
    AlignNeedsViews,
    /// A mesh cannot be aligned by the cameras of its run or scene.
    #[error("--align: the cameras of `{path}` cannot be brought to those of --views: {reason}")]
    #[diagnostic(help(
        "a similarity needs three images or more of the same names in both, taken by pinhole cameras"
    ))]
    Alignment {
        /// The run or scene of the mesh.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
}

impl MetricsError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Raster(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
