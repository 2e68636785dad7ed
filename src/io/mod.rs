//! GDAL in and out: reading bands and metadata, writing Cloud-Optimized GeoTIFFs and PNGs.

mod atomic;
mod canvas;
mod cloud;
mod crs;
mod file;
mod geoid;
mod grid;
mod heights;
mod mask;
mod plane;
mod style;
mod valid;
mod vector;
mod vertical;
mod write;

pub use atomic::{check_writable, write_atomically, write_file};
pub use canvas::Canvas;
pub use cloud::{CloudPoint, PointCloud, epsg_of_cloud};
pub use crs::{egm96_undulation_m, epsg_of_wkt, is_metric_map};
pub use file::{Band, ImageFile, Window};
pub use geoid::Geoid;
pub use grid::MapGrid;
pub use heights::{HeightSystem, read_heights};
pub use plane::Plane;
pub use style::color_style;
pub use valid::ValidPixels;
pub use vector::{Marker, Outline, inside_polygons, write_markers, write_outlines};
pub use vertical::Vertical;
pub use write::{Cog, SensorImage, png_rgb, write_moved, write_png_gray, write_png_rgb, write_with_rpc};

use std::path::PathBuf;

/// Why a raster could not be read or written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum RasterError {
    /// GDAL does not open it.
    #[error("`{path}` cannot be opened as a raster: {reason}")]
    #[diagnostic(help("`gdalinfo` tells what GDAL makes of the file"))]
    Open {
        /// The file.
        path: PathBuf,
        /// GDAL's words.
        reason: String,
    },
    /// Too small to be an image, or larger than the file could hold.
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
    /// The band asked for does not exist.
    #[error("`{path}` has {found} bands, band {asked} was asked for")]
    #[diagnostic(help("`satgs info` lists the bands of every image"))]
    NoBand {
        /// The file.
        path: PathBuf,
        /// Bands in the file.
        found: usize,
        /// Band asked for, from 1.
        asked: usize,
    },
    /// Pixels could not be read, most often because the file is cut short.
    #[error("`{path}`: reading pixels failed: {reason}")]
    #[diagnostic(help("is the file complete?"))]
    Read {
        /// The file.
        path: PathBuf,
        /// GDAL's words.
        reason: String,
    },
    /// The file lacks a geotransform satgs understands.
    #[error("`{path}`: {reason}")]
    #[diagnostic(help("expected a north-up raster in a projected CRS with an EPSG code, in metres"))]
    NotAMap {
        /// The file.
        path: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// No grid of a geoid model.
    #[error("PROJ's folders hold no grid of `{name}`")]
    #[diagnostic(help(
        "install Debian's proj-data, or give the path of the model's grid (.gtx, .tif from cdn.proj.org)"
    ))]
    NoGeoid {
        /// The model.
        name: String,
    },
    /// Neither the name of a vertical reference nor a file.
    #[error("`{name}` is no vertical reference that is known")]
    #[diagnostic(help(
        "known are `ellipsoid`, EGM84, EGM96, EGM2008, and the path of a geoid's grid (.gtx, .tif from cdn.proj.org)"
    ))]
    UnknownVertical {
        /// What was given.
        name: String,
    },
    /// The heights' unit is none that is known.
    #[error("`{path}`: heights in `{unit}` cannot be compared")]
    #[diagnostic(help("metres, feet and US survey feet are understood"))]
    HeightUnit {
        /// The raster.
        path: PathBuf,
        /// Unit of its band or of its vertical CRS.
        unit: String,
    },
    /// A vector file holds nothing that a raster can be masked with.
    #[error("`{path}` cannot be used as a mask: {reason}")]
    #[diagnostic(help("a mask is a vector file of polygons with a CRS, or a raster that is not 0 inside"))]
    Mask {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A picture could not be encoded.
    #[error("a picture of {width} x {height} pixels cannot be encoded: {reason}")]
    #[diagnostic(code(satgs::failed))]
    Picture {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// The encoder's words.
        reason: String,
    },
    /// An output could not be written; nothing is left of it.
    #[error("writing `{path}` failed: {reason}")]
    #[diagnostic(code(satgs::failed))]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's or GDAL's words.
        reason: String,
    },
}
