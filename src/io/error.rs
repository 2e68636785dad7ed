//! Errors of reading and writing files, one type per kind of file.

use crate::fault::ErrorKind;
use crate::frame::FrameError;
use gdal::errors::GdalError;
use std::io;
use std::path::{Path, PathBuf};

/// The error of a library that satgs reads or writes files with.
pub type Cause = Box<dyn std::error::Error + Send + Sync>;

/// A file could not be written. Nothing is left of it, and an earlier file of that name is unchanged.
#[derive(Debug, thiserror::Error)]
#[error("writing `{path}` failed: {cause}")]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// Error of the file system or of the encoder.
    pub cause: Cause,
}

impl WriteError {
    /// The error of writing `path`; `cause` may be an error or a sentence.
    pub fn new(path: &Path, cause: impl Into<Cause>) -> Self {
        Self { path: path.into(), cause: cause.into() }
    }

    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        if self.is_full() { ErrorKind::Resources } else { ErrorKind::Failed }
    }

    /// Whether the disk, or the user's share of it, is full.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.is_of(
            &[io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded],
            &["No space left", "quota exceeded"],
        )
    }

    /// Whether the cause is of one of these kinds; libraries that hide the kind keep the words of the operating system.
    fn is_of(&self, kinds: &[io::ErrorKind], words: &[&str]) -> bool {
        let first: &(dyn std::error::Error + 'static) = self.cause.as_ref();
        let mut causes = std::iter::successors(Some(first), |cause| cause.source());
        let kind = causes.find_map(|cause| cause.downcast_ref::<io::Error>()).map(io::Error::kind);
        let text = self.cause.to_string();
        kind.is_some_and(|kind| kinds.contains(&kind)) || words.iter().any(|words| text.contains(words))
    }
}

impl miette::Diagnostic for WriteError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        let closed = [io::ErrorKind::ReadOnlyFilesystem, io::ErrorKind::PermissionDenied];
        if self.is_full() {
            return Some(Box::new(
                "the disk is full: what is complete is kept; free space, and the same command continues",
            ));
        }
        let closed = self.is_of(&closed, &["Read-only file system", "Permission denied"]);
        // The folder of the file cannot be made, as in /proc.
        let absent = self.is_of(&[io::ErrorKind::NotFound], &[]);
        (closed || absent).then(|| {
            Box::new("nothing can be written there: choose another folder, such as -o ~/run") as Box<_>
        })
    }
}

/// A text file, JSON or CSV could not be read: it is absent, or its content is damaged.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[error("reading `{path}` failed: {cause}")]
pub struct ReadError {
    /// The file.
    pub path: PathBuf,
    /// Error of the file system or of the parser.
    pub cause: Cause,
}

impl ReadError {
    /// The error of reading `path`; `cause` may be an error or a sentence.
    pub fn new(path: &Path, cause: impl Into<Cause>) -> Self {
        Self { path: path.into(), cause: cause.into() }
    }
}

/// Why a GDAL raster could not be read, or a copy of it not be written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum RasterError {
    /// GDAL cannot open the file.
    #[error("`{path}` cannot be opened as a raster: {cause}")]
    #[diagnostic(help("`gdalinfo` shows what GDAL reads from the file"))]
    Open {
        /// The file.
        path: PathBuf,
        /// Error of the file system or of GDAL.
        cause: Cause,
    },
    /// The raster is too small to be an image, or the file is too small to hold it.
    #[error("`{path}` is {width} x {height} pixels in {bytes} bytes: {reason}")]
    #[diagnostic(help("is the file complete?"))]
    Size {
        /// The file.
        path: PathBuf,
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Size of the file.
        bytes: u64,
        /// What is wrong with it.
        reason: &'static str,
    },
    /// The requested band does not exist.
    #[error("`{path}` has {found} bands, band {asked} was asked for")]
    #[diagnostic(help("`satgs info` lists the bands of every image"))]
    NoBand {
        /// The file.
        path: PathBuf,
        /// Number of bands in the file.
        found: usize,
        /// The requested band, from 1.
        asked: usize,
    },
    /// Pixels could not be read, most often because the file is cut short.
    #[error("`{path}`: reading pixels failed: {cause}")]
    #[diagnostic(help("is the file complete?"))]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of GDAL.
        cause: GdalError,
    },
    /// An array has not the shape of a map.
    #[error("`{path}` is {reason}")]
    #[diagnostic(help("a map is an array of rows x columns, and of three numbers each for normals"))]
    Array {
        /// The file.
        path: PathBuf,
        /// Its shape, and those that are expected.
        reason: String,
    },
    /// A file of an array cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Numbers(#[from] ReadError),
    /// The raster has no map grid that satgs can use.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help("expected a north-up raster in a projected CRS with an EPSG code, in metres"))]
    NotAMap {
        /// The file.
        path: PathBuf,
        /// What is missing.
        reason: &'static str,
    },
    /// The raster holds something else than heights.
    #[error("`{path}` holds no heights: {found}")]
    #[diagnostic(help(
        "expected a surface model, such as RUN/dsm.tif: its first band holds heights; whole metres in 8 bits count as heights if \
         the band has a unit (`gdalinfo` shows bands and units)"
    ))]
    NotHeights {
        /// The raster.
        path: PathBuf,
        /// What its first band holds.
        found: String,
    },
    /// The unit of the heights is unknown.
    #[error("`{path}`: heights in `{unit}` cannot be compared")]
    #[diagnostic(help("metres, feet and US survey feet are understood"))]
    HeightUnit {
        /// The raster.
        path: PathBuf,
        /// Unit of its band or of its vertical CRS.
        unit: String,
    },
    /// An image could not be encoded as PNG.
    #[error("an image of {width} x {height} pixels cannot be encoded as PNG: {cause}")]
    Encode {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Error of the encoder.
        cause: Cause,
    },
    /// A raster could not be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}

impl RasterError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Encode { .. } => ErrorKind::Failed,
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}

/// Why a vector file (GeoPackage, GeoJSON, shapefile, …) could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum VectorError {
    /// The file has no CRS or no polygons.
    #[error("`{path}` cannot be used as a mask: {cause}")]
    #[diagnostic(help(
        "a mask is a vector file of polygons with a CRS, or a raster whose values are not 0 inside the mask"
    ))]
    Mask {
        /// The file.
        path: PathBuf,
        /// Error of GDAL, or what is missing.
        cause: Cause,
    },
}

/// Why a point cloud (LAS or LAZ) could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum CloudError {
    /// The file cannot be opened or decoded.
    #[error("`{path}` cannot be read as a point cloud: {cause}")]
    #[diagnostic(help("a complete LAS or LAZ file is needed; `pdal info` or `lasinfo` shows its content"))]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the LAS reader.
        cause: las::Error,
    },
    /// The file has a header but no points.
    #[error("`{path}`: the point cloud holds no points")]
    #[diagnostic(help("a complete LAS or LAZ file is needed; `pdal info` or `lasinfo` shows its content"))]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file holds fewer points than its header says.
    #[error("`{path}`: the point cloud ends after {found} of {expected} points")]
    #[diagnostic(help("a complete LAS or LAZ file is needed; `pdal info` or `lasinfo` shows its content"))]
    CutShort {
        /// The file.
        path: PathBuf,
        /// Points that were read.
        found: u64,
        /// Points according to the header.
        expected: u64,
    },
}

/// Why a vertical reference could not be used.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum VerticalError {
    /// The grid of a known geoid model is not installed.
    #[error("PROJ's folders hold no grid of `{name}`")]
    #[diagnostic(help("download https://cdn.proj.org/{grid} and give its path in place of the name"))]
    NoGrid {
        /// The geoid model.
        name: String,
        /// The file of its grid in PROJ's data.
        grid: String,
    },
    /// The text is neither the name of a vertical reference nor a file.
    #[error("`{name}` is not a known vertical reference")]
    #[diagnostic(help(
        "known are `ellipsoid`, EGM84, EGM96, EGM2008, and the path of a geoid's grid (.gtx, .tif from cdn.proj.org)"
    ))]
    Unknown {
        /// The given text.
        name: String,
    },
    /// The geoid's grid cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Grid(#[from] FrameError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use miette::Diagnostic;

    #[test]
    fn a_full_or_closed_disk_has_a_next_step() {
        let path = Path::new("run/dsm.tif");
        let full = WriteError::new(path, io::Error::from(io::ErrorKind::StorageFull));
        let of_library = WriteError::new(path, "_tiffWriteProc: No space left on device");
        for error in [full, of_library] {
            assert!(error.is_full());
            assert!(error.help().unwrap().to_string().contains("free space"));
        }
        let closed = WriteError::new(path, io::Error::from(io::ErrorKind::ReadOnlyFilesystem));
        assert!(!closed.is_full());
        assert!(closed.help().unwrap().to_string().contains("another folder"));
        assert!(WriteError::new(path, "a sentence").help().is_none());
    }
}
