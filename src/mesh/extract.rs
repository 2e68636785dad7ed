//! The zero surface of a signed distance function, by marching cubes (Lorensen and Cline 1987) with shared vertices.
//!
//! A vertex belongs to the edge of voxels that it lies on, an edge to the voxel that it begins at. Cubes with an unknown corner
//! have no triangles.

use super::TriangleMesh;
use super::cube_table::{EDGES, TRIANGLES};
use super::tsdf::{BlockKey, SIDE, TsdfVolume, VOXELS, VoxelBlock};
use glam::Vec3;
use rayon::prelude::*;

/// Voxels along each side of a block with those that its cubes and gradients need: one before it, two behind it.
const WIDE: usize = SIDE + 3;
/// Colour of vertices that no depth map with colours has seen.
const GRAY: f32 = 0.5;

/// The distances of a block and of the voxels around it; NaN where unknown.
struct Surrounded<'a> {
    /// The block and its neighbours behind it, by the bits x, y, z.
    blocks: [Option<&'a VoxelBlock>; 8],
    distance: Vec<f32>,
}

/// A corner of a triangle: the neighbour that has its edge (bits x, y, z), and the edge there: voxel * 3 + axis.
type Corner = (u8, u16);

/// The surface in a block.
#[derive(Default)]
struct Patch {
    /// Edges with a vertex, sorted.
    edges: Vec<u16>,
    vertices: Vec<[f64; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    triangles: Vec<[Corner; 3]>,
}

impl TsdfVolume {
    /// The zero surface. Vertices, with normals and colours, are ordered by blocks; some may belong to no triangle.
    #[must_use]
    pub fn surface(&self) -> TriangleMesh {
        let keys = self.sorted_keys();
        let patches: Vec<Patch> = keys.par_iter().map(|key| self.patch(*key)).collect();
        let starts: Vec<u32> = patches
            .iter()
            .scan(0, |next, p| Some(std::mem::replace(next, *next + p.vertices.len() as u32)))
            .collect();
        // The vertex of a corner, in the block that has its edge.
        let vertex = |key: &BlockKey, (neighbour, edge): Corner| {
            let owner = neighbour_key(*key, neighbour);
            let place = keys.binary_search(&owner).ok()?;
            let within = patches[place].edges.binary_search(&edge).ok()?;
            Some(starts[place] + within as u32)
        };
        let triangles_of = |(key, patch): (&BlockKey, &Patch)| {
            let triangle = |t: &[Corner; 3]| {
                let [a, b, c] = t.map(|corner| vertex(key, corner));
                Some([a?, b?, c?])
            };
            patch.triangles.iter().filter_map(triangle).collect::<Vec<_>>()
        };
        let triangles: Vec<Vec<[u32; 3]>> = keys.par_iter().zip(&patches).map(triangles_of).collect();
        let mut mesh = TriangleMesh { triangles: triangles.concat(), ..TriangleMesh::default() };
        for patch in patches {
            mesh.vertices.extend(patch.vertices);
            mesh.normals.extend(patch.normals);
            mesh.colors.extend(patch.colors);
        }
        mesh
    }

    fn patch(&self, key: BlockKey) -> Patch {
        let around = self.surrounded(key);
        let mut patch = Patch::default();
        for voxel in 0..VOXELS {
            let at = place(voxel);
            for axis in 0..3 {
                if let Some(t) = around.crossing(at, axis) {
                    patch.edges.push((voxel * 3 + axis) as u16);
                    self.add_vertex(&mut patch, &around, key, (at, axis, t));
                }
            }
            around.add_triangles(at, &mut patch.triangles);
        }
        patch
    }

    /// The distances of a block and around it.
    fn surrounded(&self, key: BlockKey) -> Surrounded<'_> {
        let mut distance = vec![f32::NAN; WIDE * WIDE * WIDE];
        // The parts of the 27 blocks around that lie in the wide block.
        let part = |d: i32| match d {
            -1 => SIDE - 1..SIDE,
            0 => 0..SIDE,
            _ => 0..2,
        };
        for d in (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]) {
            let Some(block) = self.block(std::array::from_fn(|k| key[k].wrapping_add(d[k]))) else {
                continue;
            };
            let shift = d.map(|d| (d * SIDE as i32 + 1) as usize);
            for z in part(d[2]) {
                for y in part(d[1]) {
                    for x in part(d[0]) {
                        let from = (z * SIDE + y) * SIDE + x;
                        let to = [x, y, z];
                        let to: [usize; 3] = std::array::from_fn(|k| to[k].wrapping_add(shift[k]));
                        if block.weight[from] > 0.0 {
                            distance[(to[2] * WIDE + to[1]) * WIDE + to[0]] = block.distance[from];
                        }
                    }
                }
            }
        }
        let blocks = std::array::from_fn(|i| self.block(neighbour_key(key, i as u8)));
        Surrounded { blocks, distance }
    }

    fn add_vertex(
        &self,
        patch: &mut Patch,
        around: &Surrounded,
        key: BlockKey,
        (at, axis, t): ([usize; 3], usize, f32),
    ) {
        let mut end = at;
        end[axis] += 1;
        let place = |k: usize| {
            let voxels = f64::from(key[k]) * SIDE as f64 + at[k] as f64;
            (voxels + if k == axis { f64::from(t) } else { 0.0 }) * self.voxel_m
        };
        patch.vertices.push(std::array::from_fn(place));
        let along = Vec3::AXES[axis] * if around.at(at) < 0.0 { 1.0 } else { -1.0 };
        let normal = around.gradient(at).lerp(around.gradient(end), t);
        patch.normals.push(normal.try_normalize().unwrap_or(along).to_array());
        let (a, b) = (around.color(at), around.color(end));
        let mix = match (a, b) {
            (Some(a), Some(b)) => a.lerp(b, t),
            _ => a.or(b).unwrap_or(Vec3::splat(GRAY)),
        };
        patch.colors.push(mix.to_array().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8));
    }
}

impl Surrounded<'_> {
    /// Distance at a voxel of the block, or up to two behind it.
    fn at(&self, [x, y, z]: [usize; 3]) -> f32 {
        self.distance[((z + 1) * WIDE + y + 1) * WIDE + x + 1]
    }

    /// Where the surface crosses the edge of a voxel, as a share of it.
    fn crossing(&self, at: [usize; 3], axis: usize) -> Option<f32> {
        let mut end = at;
        end[axis] += 1;
        let (a, b) = (self.at(at), self.at(end));
        let is_crossed = !a.is_nan() && !b.is_nan() && (a < 0.0) != (b < 0.0);
        is_crossed.then(|| a / (a - b))
    }

    fn add_triangles(&self, at: [usize; 3], out: &mut Vec<[Corner; 3]>) {
        let corner = |c: usize| std::array::from_fn(|k| at[k] + (c >> k & 1));
        let mut case = 0;
        for c in 0..8 {
            let distance = self.at(corner(c));
            if distance.is_nan() {
                return;
            }
            case |= usize::from(distance < 0.0) << c;
        }
        let vertex = |e: u8| {
            let (first, axis) = EDGES[usize::from(e)];
            let p: [usize; 3] = corner(first);
            let neighbour = (0..3).map(|k| (p[k] / SIDE) << k).sum::<usize>();
            let [x, y, z] = p.map(|v| v % SIDE);
            (neighbour as u8, (((z * SIDE + y) * SIDE + x) * 3 + axis) as u16)
        };
        out.extend(TRIANGLES[case].iter().map(|t| t.map(vertex)));
    }

    /// Central differences of the distance, or one-sided where a neighbour is unknown; zero where both are.
    fn gradient(&self, at: [usize; 3]) -> Vec3 {
        let index = ((at[2] + 1) * WIDE + at[1] + 1) * WIDE + at[0] + 1;
        let steps = [1, WIDE, WIDE * WIDE];
        let middle = self.distance[index];
        Vec3::from_array(steps.map(|step| {
            let (low, high) = (self.distance[index - step], self.distance[index + step]);
            match (low.is_nan(), high.is_nan()) {
                (false, false) => 0.5 * (high - low),
                (false, true) => middle - low,
                (true, false) => high - middle,
                (true, true) => 0.0,
            }
        }))
    }

    /// Colour of a voxel of the block, or one behind it; none if it is unknown.
    fn color(&self, at: [usize; 3]) -> Option<Vec3> {
        let neighbour = (0..3).map(|k| (at[k] / SIDE) << k).sum::<usize>();
        let [x, y, z] = at.map(|v| v % SIDE);
        let [r, g, b, weight] = self.blocks[neighbour]?.color[(z * SIDE + y) * SIDE + x];
        (weight > 0.0).then_some(Vec3::new(r, g, b))
    }
}

fn place(voxel: usize) -> [usize; 3] {
    [voxel % SIDE, voxel / SIDE % SIDE, voxel / (SIDE * SIDE)]
}

/// The block at, or one behind, along each axis by the bits x, y, z.
fn neighbour_key(key: BlockKey, bits: u8) -> BlockKey {
    std::array::from_fn(|k| key[k].wrapping_add(i32::from(bits >> k & 1)))
}
