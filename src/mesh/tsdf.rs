//! A truncated signed distance function in blocks of voxels (Curless and Levoy 1996), allocated where surfaces are (Nießner et
//! al. 2013). Blocks are processed in parallel and depth maps one after the other, so that the result does not depend on the
//! number of threads.

use super::camera::NearCamera;
use super::{DepthMap, MeshError};
use crate::io::Grid2;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Voxels along each side of a block.
pub(super) const SIDE: usize = 8;
pub(super) const VOXELS: usize = SIDE * SIDE * SIDE;
/// The most memory that the blocks of a volume may take, bytes.
const MOST_BYTES: u64 = 4 << 30;
const BYTES_IN_GIB: f64 = (1u64 << 30) as f64;
/// Rows of pixels that are searched for blocks at a time, and the number of blocks that are remembered meanwhile.
const ROWS_AT_ONCE: usize = 16;
const REMEMBERED: usize = 1024;
/// Blocks are searched along a ray up to the distance at which it is the truncation distance from the surface, but not if their
/// angle has a smaller cosine.
const LEAST_COSINE: f64 = 0.25;
/// Largest coordinate of a block; greater ones are no places.
const FARTHEST: f64 = 1e8;

/// The coordinates of a block: its place divided by its side.
pub(super) type BlockKey = [i32; 3];

/// The voxels of a block, x fastest. A voxel stands at its lowest corner.
#[derive(Clone)]
pub(super) struct VoxelBlock {
    /// Mean distance from the surface, as a share of the truncation distance; positive outside.
    pub distance: [f32; VOXELS],
    /// Sum of the weights of the depth maps that saw the voxel; 0: unknown.
    pub weight: [f32; VOXELS],
    /// Mean red, green and blue, and the sum of weights.
    pub color: [[f32; 4]; VOXELS],
}

impl VoxelBlock {
    fn unseen() -> Box<Self> {
        Box::new(Self { distance: [0.0; VOXELS], weight: [0.0; VOXELS], color: [[0.0; 4]; VOXELS] })
    }
}

/// A truncated signed distance function.
pub struct TsdfVolume {
    pub(super) voxel_m: f64,
    truncation_m: f64,
    /// Memory that the blocks may take, bytes.
    pub(super) most_bytes: u64,
    /// The number of each block. It is looked up only, as its order is not fixed.
    index: HashMap<BlockKey, u32>,
    keys: Vec<BlockKey>,
    blocks: Vec<Box<VoxelBlock>>,
}

impl TsdfVolume {
    /// An empty volume with voxels of a side and a truncation distance in metres, both above zero. Distances from surfaces are
    /// known up to the truncation distance on both sides.
    #[must_use]
    pub fn new(voxel_m: f64, truncation_m: f64) -> Self {
        Self {
            voxel_m,
            truncation_m,
            most_bytes: MOST_BYTES,
            index: HashMap::new(),
            keys: Vec::new(),
            blocks: Vec::new(),
        }
    }

    /// Memory of the blocks, bytes.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.blocks.len() as u64 * size_of::<VoxelBlock>() as u64
    }

    /// A block and its voxels.
    pub(super) fn block(&self, key: BlockKey) -> Option<&VoxelBlock> {
        self.index.get(&key).map(|i| &*self.blocks[*i as usize])
    }

    /// The coordinates of all blocks, sorted.
    pub(super) fn sorted_keys(&self) -> Vec<BlockKey> {
        let mut keys = self.keys.clone();
        keys.par_sort_unstable();
        keys
    }

    /// Takes a depth map into the means of the voxels near its surface, whose planes must have the size of its camera.
    ///
    /// # Errors
    /// [`MeshError::TooLarge`] if the volume would exceed its memory.
    pub fn integrate(&mut self, map: &DepthMap) -> Result<(), MeshError> {
        let keys = self.blocks_near(map);
        let mut is_near = vec![false; self.blocks.len()];
        for key in keys {
            let next = self.blocks.len() as u32;
            let place = *self.index.entry(key).or_insert(next);
            if place == next {
                if self.bytes() + size_of::<VoxelBlock>() as u64 > self.most_bytes {
                    let limit_gib = self.most_bytes as f64 / BYTES_IN_GIB;
                    return Err(MeshError::TooLarge { voxel_m: self.voxel_m, limit_gib });
                }
                self.keys.push(key);
                self.blocks.push(VoxelBlock::unseen());
                is_near.push(true);
            } else {
                is_near[place as usize] = true;
            }
        }
        let (voxel_m, truncation_m) = (self.voxel_m, self.truncation_m);
        let blocks = self.blocks.par_iter_mut().zip(&self.keys).zip(&is_near);
        blocks.filter(|(_, is_near)| **is_near).for_each(|((block, key), _)| {
            let corner = DVec3::from_array(key.map(|k| f64::from(k) * SIDE as f64 * voxel_m));
            let middle = corner + 0.5 * (SIDE - 1) as f64 * voxel_m;
            let from_middle = (corner - middle).as_vec3();
            block.integrate(map, &map.camera.near(middle), from_middle, voxel_m as f32, truncation_m as f32);
        });
        Ok(())
    }

    /// The blocks that the rays of a map pass within the truncation distance of its surface, sorted.
    fn blocks_near(&self, map: &DepthMap) -> Vec<BlockKey> {
        let width = map.depth.width;
        let side = self.voxel_m * SIDE as f64;
        let of_rows = |(chunk, depths): (usize, &[f32])| {
            let mut found: Vec<BlockKey> = Vec::new();
            let mut remembered = [[i32::MAX; 3]; REMEMBERED];
            for (i, depth) in depths.iter().enumerate().filter(|(_, depth)| depth.is_finite()) {
                let (col, row) = ((i % width) as f64, (chunk * ROWS_AT_ONCE + i / width) as f64);
                let p = map.camera.point(col, row, f64::from(*depth));
                let along = map.camera.step(col, row).normalize_or_zero();
                let pixel = chunk * ROWS_AT_ONCE * width + i;
                let normal = map.normal_at(pixel).map_or(along, Vec3::as_dvec3);
                let reach = self.truncation_m / along.dot(normal).abs().max(LEAST_COSINE);
                let steps = (4.0 * reach / side).ceil().max(1.0);
                for k in 0..=steps as u32 {
                    let t = reach * (2.0 * f64::from(k) / steps - 1.0);
                    let place = ((p + t * along) / side).floor();
                    if place.is_nan() || place.abs().max_element() >= FARTHEST {
                        continue;
                    }
                    let key = place.to_array().map(|v| v as i32);
                    let slot = &mut remembered[slot(key)];
                    if *slot != key {
                        *slot = key;
                        found.push(key);
                    }
                }
            }
            found.sort_unstable();
            found.dedup();
            found
        };
        let rows = map.depth.data.par_chunks((ROWS_AT_ONCE * width).max(1)).enumerate().map(of_rows);
        let mut keys = rows.collect::<Vec<_>>().concat();
        keys.par_sort_unstable();
        keys.dedup();
        keys
    }
}

/// The place at which a block is remembered; neighbours have different ones.
fn slot([x, y, z]: BlockKey) -> usize {
    (x & 15 | (y & 7) << 4 | (z & 7) << 7) as usize
}

impl VoxelBlock {
    /// Takes the distances of a depth map into the means. The first voxel lies at `first` from the point that the camera was
    /// made for.
    fn integrate(&mut self, map: &DepthMap, camera: &NearCamera, first: Vec3, voxel: f32, truncation: f32) {
        for i in 0..VOXELS {
            let step = Vec3::new((i % SIDE) as f32, (i / SIDE % SIDE) as f32, (i / (SIDE * SIDE)) as f32);
            let Some(seen) = camera.see(first + voxel * step) else { continue };
            let Some((surface, pixel)) = depth_at(&map.depth, seen.col, seen.row, truncation) else {
                continue;
            };
            let scale = camera.distance_by_depth(&seen, map.normal_at(pixel));
            let distance = camera.nearer(seen.depth, surface) * scale;
            if distance < -truncation {
                continue;
            }
            let weight = self.weight[i] + map.weight;
            self.distance[i] += ((distance / truncation).min(1.0) - self.distance[i]) * (map.weight / weight);
            self.weight[i] = weight;
            if distance < truncation
                && let Some(color) = &map.color
            {
                self.add_color(i, color.each_ref().map(|c| c.data[pixel]), map.weight);
            }
        }
    }

    fn add_color(&mut self, voxel: usize, color: [f32; 3], weight: f32) {
        if color.iter().all(|c| c.is_finite()) {
            let [r, g, b, sum] = &mut self.color[voxel];
            *sum += weight;
            for (mean, c) in [r, g, b].into_iter().zip(color) {
                *mean += (c - *mean) * (weight / *sum);
            }
        }
    }
}

/// The depth at an image position between centres of pixels, and the nearest pixel: interpolated between the four pixels around where these agree to a
/// tolerance, else that of the nearest pixel, because there is no surface between the two sides of a depth edge.
fn depth_at(depth: &Grid2, col: f32, row: f32, tolerance: f32) -> Option<(f32, usize)> {
    let (width, height) = (depth.width, depth.height);
    let is_inside = col >= 0.0 && row >= 0.0 && col <= width as f32 - 1.0 && row <= height as f32 - 1.0;
    if !is_inside || width < 2 || height < 2 {
        return None;
    }
    let nearest = (row + 0.5) as usize * width + (col + 0.5) as usize;
    let z = *depth.data.get(nearest)?;
    if z.is_nan() {
        return None;
    }
    let (c, r) = ((col as usize).min(width - 2), (row as usize).min(height - 2));
    let i = r * width + c;
    let [a, b, c, d] = [i, i + 1, i + width, i + width + 1].map(|i| depth.data[i]);
    let spread = a.max(b).max(c).max(d) - a.min(b).min(c).min(d);
    if (a + b + c + d).is_nan() || spread > tolerance {
        return Some((z, nearest));
    }
    let (u, v) = (col - (i % width) as f32, row - (i / width) as f32);
    let (upper, lower) = (a + (b - a) * u, c + (d - c) * u);
    Some((upper + (lower - upper) * v, nearest))
}
