//! Reading and writing of files: rasters, point clouds, vector files, images, charts, JSON.

mod atomic;
mod blocks;
mod box_filters;
mod chart;
mod cloud;
mod crs;
mod disk;
mod error;
mod file;
mod gdal_setup;
mod gdal_vsi;
mod georeference;
mod grid;
mod height_unit;
mod heights;
mod json;
mod lettering;
mod like;
mod mask;
mod memory;
mod grid2;
mod npy;
mod rgb_image;
mod number_kind;
mod planes;
mod ply;
mod ply_header;
mod style;
pub mod svg;
mod text;
mod valid;
mod vector;
mod vertical_reference;
pub mod vsi;
mod window;
mod write;

pub use atomic::{check_writable, remove_if_there, write_atomically, write_file};
pub use blocks::Blocks;
pub use box_filters::{box_means, box_openings, box_ranges, box_sums};
pub use chart::{Chart, round_below};
pub use cloud::{CloudContent, CloudPoint, PointCloud, epsg_of_cloud, read_points};
pub use crs::{epsg_of_wkt, is_metric_map};
pub use disk::free_disk_bytes;
pub use error::{Cause, CloudError, RasterError, ReadError, VectorError, VerticalError, WriteError};
pub use file::{BandInfo, ImageFile, is_measurement};
pub use georeference::{
    georeference, georeference_comment, read_georeference, replaces_georeference, write_georeference,
};
pub use grid::MapGrid;
pub use grid2::Grid2;
pub use heights::{HeightSystem, read_heights};
pub use json::{read_json, read_python_json, write_json};
pub use like::{MosaicPart, Template};
pub use memory::{available_memory_mb, peak_memory_mb, reset_peak_memory};
pub use npy::NpyArray;
pub use number_kind::NumberKind;
pub use planes::Planes;
pub use ply::PlyContent;
pub use rgb_image::RgbImage;
pub use style::{ColorStops, color_pipe, color_style, picture_pipe, pipe_of_style, relief_pipe};
pub use svg::{Drawing, escape_xml};
pub use text::{decode_text, parse_number, read_text};
pub use valid::ValidPixels;
pub use vector::{
    MapFeature, MapShape, Marker, Outline, inside_polygons, write_map_features, write_markers, write_outlines,
};
pub use vertical_reference::{GeoidDifference, VerticalReference};
pub use window::Window;
pub use write::{
    Cog, SensorImage, png_rgb, write_moved, write_png_gray, write_png_gray16, write_png_rgb, write_with_rpc,
};
