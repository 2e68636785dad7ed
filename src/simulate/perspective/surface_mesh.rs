//! Triangle meshes of exact surfaces, and their PLY files.

use crate::io::{WriteError, write_file};
use glam::DVec3;
use std::path::Path;

/// Marks a vertex of a grid that no cell uses.
const UNUSED: u32 = u32::MAX;

/// Triangles with coloured vertices.
#[derive(Clone, Debug, Default)]
pub(in crate::simulate) struct SurfaceMesh {
    /// Positions, metres.
    pub(in crate::simulate) vertices: Vec<[f32; 3]>,
    /// Red, green, blue of each vertex.
    pub(in crate::simulate) colors: Vec<[u8; 3]>,
    /// Three vertices each, counter-clockwise seen from the side that is visible.
    pub(in crate::simulate) triangles: Vec<[u32; 3]>,
}

impl SurfaceMesh {
    /// Adds a grid of `cells` quadrilaterals along its two axes, two triangles each; `vertex` gives position and colour at a
    /// node. The visible side is that from which the second axis is reached from the first one counter-clockwise. Cells that
    /// `is_there` denies are left out.
    pub(in crate::simulate) fn add_grid(
        &mut self,
        cells: [usize; 2],
        vertex: impl Fn(usize, usize) -> (DVec3, [u8; 3]),
        is_there: impl Fn(usize, usize) -> bool,
    ) {
        let columns = cells[0] + 1;
        let mut numbers = vec![UNUSED; columns * (cells[1] + 1)];
        for j in 0..cells[1] {
            for i in (0..cells[0]).filter(|i| is_there(*i, j)) {
                let [a, b, c, d] = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(i, j)| {
                    let number = &mut numbers[j * columns + i];
                    if *number == UNUSED {
                        *number = self.vertices.len() as u32;
                        let (place, color) = vertex(i, j);
                        self.vertices.push(place.as_vec3().to_array());
                        self.colors.push(color);
                    }
                    *number
                });
                self.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }

    /// Writes the mesh as a binary PLY file.
    pub(in crate::simulate) fn write(&self, path: &Path) -> Result<(), WriteError> {
        let mut out = format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n\
             property list uchar int vertex_indices\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )
        .into_bytes();
        for (place, color) in self.vertices.iter().zip(&self.colors) {
            out.extend(place.iter().flat_map(|v| v.to_le_bytes()));
            out.extend(color);
        }
        for triangle in &self.triangles {
            out.push(3);
            out.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
        }
        write_file(path, out)
    }
}
