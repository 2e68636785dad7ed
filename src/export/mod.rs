//! Runs in the forms that other programs read: satellite views as local pinhole cameras with resampled images, splats in
//! the files that viewers and globes ask for.

mod axes;
mod colmap_builder;
pub mod compressed_ply;
mod error;
mod image_map;
mod local_pinhole;
mod packing;
mod resample;
mod splat_file;
pub mod splat_gltf;
mod splat_ply;
pub mod spz;
#[cfg(test)]
mod test_splats;
pub mod tiles3d;

pub use axes::Axes;
pub use colmap_builder::ColmapBuilder;
pub use error::ExportError;
pub use image_map::ImageMap;
pub use local_pinhole::{Fitted, LocalPinhole};
pub use resample::Resampled;
pub use splat_file::{SplatFile, SplatFileInfo, SplatFormat};
pub use splat_gltf::{GltfCompression, GltfScene};
pub use splat_ply::PlyVariant;
