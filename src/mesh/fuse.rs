//! From depth maps to a mesh.

use super::{DepthMap, MeshError, TriangleMesh, TsdfVolume, keep_largest_pieces};
use crate::progress::{Event, Interrupted, Progress};

/// Which pieces of a fused mesh are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KeptPieces {
    /// At most this many, the largest.
    pub most: usize,
    /// Each of at least this many triangles.
    pub least_triangles: usize,
}

impl KeptPieces {
    /// All pieces.
    pub const ALL: Self = Self { most: usize::MAX, least_triangles: 1 };
    /// The pieces that the authors' code of Huang et al. 2024 (2D Gaussian splatting) keeps.
    pub const LARGEST: Self = Self { most: 50, least_triangles: 50 };
}

/// How depth maps are fused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FuseOptions {
    /// Side of a voxel, metres.
    pub voxel_m: f64,
    /// Truncation distance of the TSDF, metres.
    pub truncation_m: f64,
    /// Depths of pinhole cameras beyond this are not used, metres.
    pub depth_max_m: Option<f64>,
    /// Surfaces outside of this box (lowest and highest coordinates, metres) are not used.
    pub bounds: Option<[[f64; 3]; 2]>,
    /// Which pieces of the mesh are kept.
    pub kept: KeptPieces,
}

/// A fused mesh, and how it came about.
#[derive(Clone, Debug)]
pub struct FusedMesh {
    /// The mesh with normals and colours. Its place on Earth and its upward direction are left to the caller.
    pub mesh: TriangleMesh,
    /// Number of depth maps.
    pub maps: usize,
    /// Number of pieces that are kept, and that there were.
    pub pieces: (usize, usize),
    /// Memory of the volume, bytes.
    pub volume_bytes: u64,
    /// Share of the depths that lie beyond the limit, 0 to 1; 0 without a limit.
    pub beyond: f64,
}

/// Fuses depth maps in their order to a mesh.
///
/// # Errors
/// That of a depth map; [`MeshError`] if a map does not fit its camera, the volume would be too large, or there is no surface;
/// [`Interrupted`].
pub fn fuse<E: From<MeshError> + From<Interrupted>>(
    maps: impl Iterator<Item = Result<DepthMap, E>>,
    options: &FuseOptions,
    progress: &dyn Progress,
) -> Result<FusedMesh, E> {
    let total = maps.size_hint().1.unwrap_or(0) as u64;
    progress.event(Event::Started { stage: "fusing depth maps", total });
    let mut volume = TsdfVolume::new(options.voxel_m, options.truncation_m);
    let (mut count, mut depths, mut beyond) = (0, 0, 0);
    for map in maps {
        progress.check()?;
        let mut map = map?;
        map.check(count)?;
        if let Some(depth_max_m) = options.depth_max_m {
            let known = map.depth.valid().count();
            map.forget_beyond(depth_max_m);
            depths += known;
            beyond += known - map.depth.valid().count();
        }
        if let Some(bounds) = options.bounds {
            map.forget_outside(bounds);
        }
        volume.integrate(&map)?;
        count += 1;
        let status = format!("{} MB", volume.bytes() / 1_000_000);
        progress.event(Event::Advanced { done: count as u64, status });
    }
    progress.check()?;
    let mut mesh = volume.surface();
    let pieces = keep_largest_pieces(&mut mesh, options.kept.most, options.kept.least_triangles);
    progress.event(Event::Finished);
    if mesh.triangles.is_empty() {
        return Err(MeshError::NoSurface { maps: count, triangles: options.kept.least_triangles }.into());
    }
    let beyond = beyond as f64 / depths.max(1) as f64;
    Ok(FusedMesh { mesh, maps: count, pieces, volume_bytes: volume.bytes(), beyond })
}

#[cfg(test)]
#[path = "fuse_tests.rs"]
mod tests;
