//! Runs in the forms that other programs read: satellite views as local pinhole cameras with resampled images, splats in
//! the variants of PLY that viewers ask for.

mod colmap_builder;
mod error;
mod image_map;
mod local_pinhole;
mod resample;
mod splat_ply;

pub use colmap_builder::ColmapBuilder;
pub use error::ExportError;
pub use image_map::ImageMap;
pub use local_pinhole::{Fitted, LocalPinhole};
pub use resample::Resampled;
pub use splat_ply::PlyVariant;
