//! Why a mesh cannot be made, read or written.

use crate::fault::ErrorKind;
use crate::io::{ReadError, WriteError};
use std::path::PathBuf;

/// Why a mesh cannot be made, read or written.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum MeshError {
    /// The file does not hold a mesh that can be read.
    #[error("`{path}` cannot be read as a mesh: {reason}")]
    #[diagnostic(help(
        "expected a PLY file (binary little-endian or ascii) with vertices x, y, z and faces vertex_indices, or an OBJ file"
    ))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// The file holds no triangles.
    #[error("`{path}` holds no triangles ({vertices} vertices)")]
    #[diagnostic(help("points are no surface: a mesh with faces is needed"))]
    NoTriangles {
        /// The file.
        path: PathBuf,
        /// Number of its vertices.
        vertices: usize,
    },
    /// The name of a file does not end in the name of a known format.
    #[error("`{path}` is not the name of a mesh that can be {action}")]
    #[diagnostic(help("the name ends in {endings}"))]
    Ending {
        /// The file.
        path: PathBuf,
        /// `read` or `written`.
        action: &'static str,
        /// The accepted endings.
        endings: &'static str,
    },
    /// A depth map has another size than the image of its camera.
    #[error(
        "depth map {index} has {} x {} pixels, its camera {} x {}", found.0, found.1, expected.0, expected.1
    )]
    #[diagnostic(help("depth maps and cameras have to be of the same scene and resolution"))]
    DepthSize {
        /// Number of the depth map, from 0.
        index: usize,
        /// Columns and rows of the map.
        found: (usize, usize),
        /// Columns and rows of the camera.
        expected: (usize, usize),
    },
    /// The volume would need too much memory.
    #[error("voxels of {voxel_m} m need more than {limit_gib} GiB of memory")]
    #[diagnostic(help("larger voxels need less: --voxel {}", 2.0 * voxel_m))]
    TooLarge {
        /// Side of a voxel, metres.
        voxel_m: f64,
        /// The largest amount that is used.
        limit_gib: f64,
    },
    /// The depth maps show no surface.
    #[error("{maps} depth maps show no surface of {triangles} or more triangles")]
    #[diagnostic(help(
        "are the depths within --depth-max, and are the voxels smaller than what is to be seen?"
    ))]
    NoSurface {
        /// Number of depth maps.
        maps: usize,
        /// Smallest number of triangles of a piece.
        triangles: usize,
    },
    /// The format cannot hold that much.
    #[error("`{path}` would exceed the 4 GiB that the format can hold")]
    #[diagnostic(help("a .ply file has no such limit"))]
    FileSize {
        /// The file.
        path: PathBuf,
    },
    /// The georeference beside a mesh cannot be read.
    #[error(transparent)]
    Georeference(#[from] ReadError),
    /// A file cannot be written.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
}

impl MeshError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Write(e) => e.kind(),
            _ => ErrorKind::Input,
        }
    }
}
