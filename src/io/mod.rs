//! GDAL in and out: reading bands and metadata, writing Cloud-Optimized GeoTIFFs and PNGs.

mod atomic;
mod canvas;
mod cloud;
mod crs;
mod error;
mod file;
mod geoid;
mod grid;
mod heights;
mod json;
mod mask;
mod grid2;
mod style;
mod valid;
mod vector;
mod vertical;
mod write;

pub use atomic::{check_writable, write_atomically, write_file};
pub use canvas::Canvas;
pub use cloud::{CloudPoint, PointCloud, epsg_of_cloud};
pub use crs::{egm96_undulation_m, epsg_of_wkt, is_metric_map};
pub use error::{Cause, CloudError, RasterError, ReadError, VectorError, VerticalError, WriteError};
pub use file::{Band, ImageFile, Window};
pub use geoid::Geoid;
pub use grid::MapGrid;
pub use grid2::Grid2;
pub use heights::{HeightSystem, read_heights};
pub use json::{read_json, write_json};
pub use style::color_style;
pub use valid::ValidPixels;
pub use vector::{Marker, Outline, inside_polygons, write_markers, write_outlines};
pub use vertical::Vertical;
pub use write::{Cog, SensorImage, png_rgb, write_moved, write_png_gray, write_png_rgb, write_with_rpc};
