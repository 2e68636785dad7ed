//! Triangle meshes: fused from depth maps, read and written as PLY, OBJ and glTF.
//!
//! [`fuse()`] puts depth maps of any [`DepthCamera`] into a [`TsdfVolume`], a truncated signed distance function in blocks of
//! voxels (Curless and Levoy 1996; Nießner et al. 2013), extracts its zero surface by marching cubes (Lorensen and Cline 1987)
//! and keeps the largest pieces. [`render_depth`] goes the other way: the depth map of a mesh.

mod camera;
mod cube_table;
mod depth_map;
mod depth_render;
mod error;
mod extract;
mod file;
mod fuse;
pub mod gltf;
mod glb;
mod obj;
mod pieces;
mod ply;
mod ply_writer;
mod surface_tree;
mod triangle_mesh;
mod tsdf;

pub use camera::DepthCamera;
pub use depth_map::DepthMap;
pub use depth_render::render_depth;
pub use error::MeshError;
pub use file::MeshFormat;
pub use fuse::{FuseOptions, FusedMesh, KeptPieces, fuse};
pub use pieces::{keep_largest_pieces, pieces};
pub use surface_tree::SurfaceTree;
pub use triangle_mesh::TriangleMesh;
pub use tsdf::TsdfVolume;
