//! Splats as 3D Tiles 1.1 (OGC 22-025r4): a tree of tiles whose inner nodes hold merged splats.
//!
//! The root's transform leads from a [`LevelFrame`](crate::frame::LevelFrame) to earth-centred coordinates. Every splat is
//! transformed by itself, so that the curvature of the Earth and of the map projection leave no error. The content of a
//! tile is glTF with `KHR_gaussian_splatting_compression_spz_2`, relative to the middle of the tile.

mod merge;
mod placed;
mod tileset;
mod tree;

pub use merge::merge;
pub use placed::place;
pub use tileset::{TilesetInfo, content, document};
pub use tree::{TileNode, join, subtree};
