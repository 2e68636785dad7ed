//! The exact mesh of the room: the surfaces that can be seen from inside.

use super::shading::{Shading, displayed};
use super::shape::{Block, LEGS, Part, ROOM, SPHERE_CENTER, SPHERE_RADIUS_M, TABLE_TOP, part_of_room};
use crate::simulate::perspective::surface_mesh::SurfaceMesh;
use glam::DVec3;

/// Distance between vertices, metres. All edges are at multiples of it.
const CELL_M: f64 = 0.02;

/// Meshes all surfaces. The floor and the lower side of the table have holes where the legs stand.
pub(super) fn of_room(shading: &Shading) -> SurfaceMesh {
    let mut mesh = SurfaceMesh::default();
    let mut builder = Builder { mesh: &mut mesh, shading };
    for axis in 0..3 {
        for outwards in [1.0, -1.0] {
            let mut normal = DVec3::ZERO;
            normal[axis] = outwards;
            builder.add_side(&ROOM, -normal, part_of_room(normal), normal);
            let part = if normal.z > 0.5 { Part::TableTop } else { Part::TableFrame };
            builder.add_side(&TABLE_TOP, normal, part, normal);
            if axis != 2 {
                LEGS.iter().for_each(|leg| builder.add_side(leg, normal, Part::TableFrame, normal));
            }
        }
    }
    builder.add_sphere();
    mesh
}

struct Builder<'a> {
    mesh: &'a mut SurfaceMesh,
    shading: &'a Shading,
}

impl Builder<'_> {
    /// Adds the side of a block that lies towards `side`; `normal` points to where it is seen from.
    fn add_side(&mut self, block: &Block, side: DVec3, part: Part, normal: DVec3) {
        let axis = (0..3).find(|k| side[*k] != 0.0).unwrap_or(0);
        // The second axis follows the first one counter-clockwise, seen against the normal.
        let (mut u, mut v) = ((axis + 1) % 3, (axis + 2) % 3);
        if normal[axis] < 0.0 {
            (u, v) = (v, u);
        }
        let mut corner = block.low;
        corner[axis] = if side[axis] > 0.0 { block.high[axis] } else { block.low[axis] };
        let size = block.high - block.low;
        let cells = [u, v].map(|k| (size[k] / CELL_M).round() as usize);
        let at = |i: f64, j: f64| {
            let mut place = corner;
            place[u] += size[u] * i / cells[0] as f64;
            place[v] += size[v] * j / cells[1] as f64;
            place
        };
        let is_covered = |place: DVec3| {
            let within = |leg: &Block| {
                (leg.low.x..leg.high.x).contains(&place.x) && (leg.low.y..leg.high.y).contains(&place.y)
            };
            (part == Part::Floor || (part == Part::TableFrame && normal.z < 0.0)) && LEGS.iter().any(within)
        };
        let shading = self.shading;
        self.mesh.add_grid(
            cells,
            |i, j| {
                let place = at(i as f64, j as f64);
                (place, displayed(shading.radiance(part, place, normal)))
            },
            |i, j| !is_covered(at(i as f64 + 0.5, j as f64 + 0.5)),
        );
    }

    /// Adds the sphere as a grid of longitudes and latitudes; the triangles at the poles have no area and are left out.
    fn add_sphere(&mut self) {
        let rings = (std::f64::consts::PI * SPHERE_RADIUS_M / CELL_M).ceil() as usize;
        let shading = self.shading;
        let first = self.mesh.triangles.len();
        self.mesh.add_grid(
            [2 * rings, rings],
            |i, j| {
                let step = std::f64::consts::PI / rings as f64;
                let (longitude, latitude) =
                    ((i % (2 * rings)) as f64 * step, (j as f64 - 0.5 * rings as f64) * step);
                let normal = DVec3::new(
                    longitude.cos() * latitude.cos(),
                    longitude.sin() * latitude.cos(),
                    latitude.sin(),
                );
                let place = SPHERE_CENTER + normal * SPHERE_RADIUS_M;
                (place, displayed(shading.radiance(Part::Sphere, place, normal)))
            },
            |_, _| true,
        );
        let vertices = &self.mesh.vertices;
        let has_area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| vertices[v as usize]);
            a != b && b != c && c != a
        };
        let sphere: Vec<_> = self.mesh.triangles.drain(first..).filter(has_area).collect();
        self.mesh.triangles.extend(sphere);
    }
}
