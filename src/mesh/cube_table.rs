//! The triangles of marching cubes (Lorensen and Cline 1987), derived for each of the 256 cases by a walk along the faces of
//! the cube.
//!
//! On a face whose corners are inside and outside in turn, the inside corners are kept apart. Two cubes see the same corners of
//! their common face and so agree there: the surface is closed.

use std::sync::LazyLock;

/// An edge of a cube: the corner it begins at (bits x, y, z), and its axis.
pub(super) type CubeEdge = (usize, usize);

/// The twelve edges.
pub(super) const EDGES: [CubeEdge; 12] =
    [(0, 0), (2, 0), (4, 0), (6, 0), (0, 1), (1, 1), (4, 1), (5, 1), (0, 2), (1, 2), (2, 2), (3, 2)];

/// For each case (bit `c` is set if corner `c` is inside) the edges of the triangles' corners, counter-clockwise seen from
/// outside.
pub(super) static TRIANGLES: LazyLock<Vec<Vec<[u8; 3]>>> =
    LazyLock::new(|| (0..256).map(triangles).collect());

/// The number of the edge between two neighbouring corners.
fn edge(a: usize, b: usize) -> usize {
    let wanted = (a.min(b), (a ^ b).trailing_zeros() as usize);
    EDGES.iter().position(|e| *e == wanted).unwrap_or_default()
}

/// The corners of a face, counter-clockwise seen from outside of the cube.
fn face(axis: usize, is_high: bool) -> [usize; 4] {
    let (b, c) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let first = usize::from(is_high) << axis;
    let mut corners = [first, first | b, first | b | c, first | c];
    if !is_high {
        corners.reverse();
    }
    corners
}

fn triangles(case: usize) -> Vec<[u8; 3]> {
    let is_inside = |corner: usize| case >> corner & 1 == 1;
    // The edge after each crossed edge, along the line in which the surface cuts a face.
    let mut next = [None; 12];
    for (axis, is_high) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
        let corners = face(axis, is_high);
        let at = |k: usize| corners[k % 4];
        for k in (0..4).filter(|k| !is_inside(at(*k)) && is_inside(at(k + 1))) {
            // The run of inside corners after corner k ends at the first that is outside again.
            let end = (k + 2..k + 5).find(|m| !is_inside(at(*m))).unwrap_or(k);
            next[edge(at(k), at(k + 1))] = Some(edge(at(end - 1), at(end)));
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let mut polygon = Vec::new();
        let mut at = start;
        while let Some(following) = next[at].take() {
            polygon.push(at as u8);
            at = following;
        }
        out.extend((2..polygon.len()).map(|k| [polygon[0], polygon[k - 1], polygon[k]]));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::collections::BTreeMap;

    fn middle(edge: u8) -> Vec3 {
        let (corner, axis) = EDGES[usize::from(edge)];
        let mut p = Vec3::from_array(std::array::from_fn(|k| (corner >> k & 1) as f32));
        p[axis] += 0.5;
        p
    }

    #[test]
    fn every_edge_of_a_triangle_inside_of_the_cube_belongs_to_two_and_no_crossed_edge_is_left_out() {
        for (case, triangles) in TRIANGLES.iter().enumerate() {
            let mut sides = BTreeMap::new();
            let mut used = [false; 12];
            for t in triangles {
                for k in 0..3 {
                    *sides.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
                    used[usize::from(t[k])] = true;
                }
            }
            for (i, (corner, axis)) in EDGES.iter().enumerate() {
                let is_crossed = (case >> corner & 1) != (case >> (corner | 1 << axis) & 1);
                assert_eq!(used[i], is_crossed, "case {case}, edge {i}");
            }
            for ((a, b), n) in &sides {
                let is_shared = sides.contains_key(&(*b, *a));
                let both = middle(*a) + middle(*b);
                let is_on_face = (0..3).any(|k| both[k] == 0.0 || both[k] == 2.0);
                assert!(*n == 1 && (is_shared || is_on_face), "case {case}: {a} {b}");
            }
        }
    }

    #[test]
    fn triangles_face_outwards() {
        for corner in 0..8 {
            let [t] = TRIANGLES[1 << corner][..] else { panic!("one corner has one triangle") };
            let [a, b, c] = t.map(middle);
            let inside = Vec3::from_array(std::array::from_fn(|k| (corner >> k & 1) as f32));
            assert!((b - a).cross(c - a).dot(a - inside) > 0.0, "corner {corner}");
        }
    }
}
