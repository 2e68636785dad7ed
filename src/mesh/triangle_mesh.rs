//! A triangle mesh in memory.

use crate::frame::SiteGrid;
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

/// Coordinates from here on need more than single precision, whose steps are half a millimetre there.
const FLOAT_REACH_M: f64 = 8192.0;
/// Marks vertices that no triangle uses.
const UNUSED: u32 = u32::MAX;

/// Triangles that share vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct TriangleMesh {
    /// Positions, metres of the site frame or of the scene's own frame.
    pub vertices: Vec<[f64; 3]>,
    /// Red, green and blue of each vertex, encoded for display; empty without colours.
    pub colors: Vec<[u8; 3]>,
    /// Unit normal of each vertex, outwards; empty without normals.
    pub normals: Vec<[f32; 3]>,
    /// Three vertices each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
    /// Where the frame is on Earth, if it is known.
    pub site: Option<SiteGrid>,
    /// Unit vector upwards.
    pub up: [f64; 3],
}

impl Default for TriangleMesh {
    /// No triangles, in a frame whose third axis points up.
    fn default() -> Self {
        Self {
            vertices: Vec::new(),
            colors: Vec::new(),
            normals: Vec::new(),
            triangles: Vec::new(),
            site: None,
            up: [0.0, 0.0, 1.0],
        }
    }
}

impl TriangleMesh {
    /// Lowest and highest coordinates of the vertices; none without vertices.
    #[must_use]
    pub fn bounds(&self) -> Option<[[f64; 3]; 2]> {
        let first = *self.vertices.first()?;
        Some(self.vertices.iter().fold([first; 2], |[low, high], p| {
            [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
        }))
    }

    /// Whether single precision is too coarse for its coordinates, as for those of a map.
    #[must_use]
    pub fn is_far(&self) -> bool {
        self.vertices.as_flattened().iter().any(|v| v.abs() >= FLOAT_REACH_M)
    }

    /// Corners of a triangle.
    ///
    /// # Panics
    /// Panics if there is no such triangle, or it names a vertex that does not exist.
    #[must_use]
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| DVec3::from_array(self.vertices[v as usize]))
    }

    /// Moves the mesh by a similarity: `scale * rotation * position + translation`.
    pub fn transform(&mut self, scale: f64, rotation: DMat3, translation: DVec3) {
        let moved = |p: &[f64; 3]| scale * (rotation * DVec3::from_array(*p)) + translation;
        self.vertices.par_iter_mut().for_each(|p| *p = moved(p).to_array());
        let turn = rotation.as_mat3();
        self.normals.par_iter_mut().for_each(|n| *n = (turn * Vec3::from_array(*n)).to_array());
        self.up = (rotation * DVec3::from_array(self.up)).to_array();
    }

    /// Keeps the triangles with `is_kept[i]`, and the vertices that they use, all in their order.
    ///
    /// # Panics
    /// Panics if there are fewer flags than triangles, or a triangle names a vertex that does not exist.
    pub fn retain(&mut self, is_kept: &[bool]) {
        let mut number = 0;
        self.triangles.retain(|_| {
            number += 1;
            is_kept[number - 1]
        });
        let mut place = vec![UNUSED; self.vertices.len()];
        self.triangles.as_flattened().iter().for_each(|v| place[*v as usize] = 0);
        for (next, place) in (0..).zip(place.iter_mut().filter(|p| **p != UNUSED)) {
            *place = next;
        }
        retain_used(&mut self.vertices, &place);
        retain_used(&mut self.colors, &place);
        retain_used(&mut self.normals, &place);
        self.triangles.as_flattened_mut().iter_mut().for_each(|v| *v = place[*v as usize]);
    }
}

/// Keeps the values of the vertices that have a place.
fn retain_used<T>(values: &mut Vec<T>, place: &[u32]) {
    let mut places = place.iter();
    values.retain(|_| places.next().is_some_and(|p| *p != UNUSED));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_that_no_kept_triangle_uses_are_dropped_with_their_colours() {
        let mut mesh = TriangleMesh {
            vertices: (0..5).map(|i| [f64::from(i); 3]).collect(),
            colors: (0..5).map(|i| [i; 3]).collect(),
            triangles: vec![[0, 1, 2], [4, 2, 3]],
            ..TriangleMesh::default()
        };
        mesh.retain(&[false, true]);
        assert_eq!(mesh.vertices, [[2.0; 3], [3.0; 3], [4.0; 3]]);
        assert_eq!(mesh.colors, [[2; 3], [3; 3], [4; 3]]);
        assert_eq!(mesh.triangles, [[2, 0, 1]]);
        assert_eq!(mesh.bounds(), Some([[2.0; 3], [4.0; 3]]));
    }
}
