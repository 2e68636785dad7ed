//! GDAL in and out: reading bands and metadata, writing Cloud-Optimized GeoTIFFs and PNGs.

mod atomic;
mod chart;
mod cloud;
mod crs;
mod error;
mod file;
mod grid;
mod heights;
mod json;
mod mask;
mod grid2;
mod rgb_image;
mod style;
pub mod svg;
mod valid;
mod vector;
mod vertical_reference;
mod write;

pub use atomic::{check_writable, write_atomically, write_file};
pub use chart::Chart;
pub use cloud::{CloudPoint, PointCloud, epsg_of_cloud};
pub use crs::{epsg_of_wkt, is_metric_map};
pub use error::{Cause, CloudError, RasterError, ReadError, VectorError, VerticalError, WriteError};
pub use file::{Band, ImageFile, Window};
pub use grid::MapGrid;
pub use grid2::Grid2;
pub use heights::{HeightSystem, read_heights};
pub use json::{read_json, write_json};
pub use rgb_image::RgbImage;
pub use style::color_style;
pub use svg::{Drawing, escape_xml};
pub use valid::ValidPixels;
pub use vector::{Marker, Outline, inside_polygons, write_markers, write_outlines};
pub use vertical_reference::VerticalReference;
pub use write::{Cog, SensorImage, png_rgb, write_moved, write_png_gray, write_png_rgb, write_with_rpc};
