//! The exact mesh of the town's middle part.

use super::DATUM_M;
use crate::simulate::field::{Field, Place};
use crate::simulate::perspective::surface_mesh::SurfaceMesh;
use glam::DVec3;

/// Half the side of the square that is meshed, metres: what most images see.
const HALF_MESH_M: f64 = 130.0;
/// Side of a quadrilateral of the mesh, metres.
const CELL_M: f64 = 0.5;
/// Height difference in a quadrilateral from which on it is divided, metres.
const STEEP_M: f64 = 0.6;
/// Largest height difference between neighbouring vertices up a wall, metres.
const RISE_M: f64 = 1.0;
/// Largest number of parts across the steeper axis; only corners of walls are steep along both axes.
const MOST_ACROSS: usize = 2;

/// Meshes the field around its centre. Vertices lie on the field, which between its nodes is a bilinear function; up a wall
/// they are [`RISE_M`] apart at most.
pub(super) fn of_field(field: &Field, color: impl Fn(Place) -> [u8; 3]) -> SurfaceMesh {
    let step_m = field.step_m();
    // Nodes of the field along the side of a quadrilateral.
    let stride = (CELL_M / step_m).round().max(1.0) as usize;
    let half = (HALF_MESH_M.min(field.half_m()) / (stride as f64 * step_m)).floor();
    let cells = 2 * half as usize;
    // Quadrilaterals begin at nodes of the field, of which one is at its south-western corner.
    let nodes_to_west = ((field.half_m() - half * stride as f64 * step_m) / step_m).round();
    let along = |node: f64| (nodes_to_west + node) * step_m - field.half_m();
    let vertex = |u: f64, v: f64| {
        let (x, y) = (along(u), along(v));
        let z = field.height_m(x, y);
        (DVec3::new(x, y, z - DATUM_M), color([x, y, z]))
    };
    let height_m = |i: usize, j: usize| field.height_m(along(i as f64), along(j as f64));
    let is_even = |i: usize, j: usize| {
        let nodes = (0..=stride).flat_map(|l| (0..=stride).map(move |k| (k, l)));
        let heights = nodes.map(|(k, l)| height_m(i * stride + k, j * stride + l));
        let (low, high) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), z| (l.min(z), h.max(z)));
        high - low < STEEP_M
    };
    let mut mesh = SurfaceMesh::default();
    let corner = |i: usize| (i * stride) as f64;
    mesh.add_grid([cells; 2], |i, j| vertex(corner(i), corner(j)), is_even);
    for (i, j) in (0..cells * cells).map(|k| (k % cells, k / cells)).filter(|(i, j)| !is_even(*i, *j)) {
        for (i, j) in (0..stride * stride).map(|k| (i * stride + k % stride, j * stride + k / stride)) {
            let [a, b, c, d] = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(k, l)| height_m(i + k, j + l));
            let parts = parts((b - a).abs().max((d - c).abs()), (c - a).abs().max((d - b).abs()));
            let at = |start: usize, k: usize, n: usize| start as f64 + k as f64 / n as f64;
            mesh.add_grid(parts, |k, l| vertex(at(i, k, parts[0]), at(j, l, parts[1])), |_, _| true);
        }
    }
    mesh
}

/// Numbers of parts of a cell of the field along its axes, by the height differences along them.
fn parts(rise_u_m: f64, rise_v_m: f64) -> [usize; 2] {
    let [u, v] = [rise_u_m, rise_v_m].map(|rise_m| (rise_m / RISE_M).ceil().max(1.0) as usize);
    if u >= v { [u, v.min(MOST_ACROSS)] } else { [u.min(MOST_ACROSS), v] }
}
