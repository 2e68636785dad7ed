//! Distances from points to the surface of a mesh: a tree of boxes around triangles.

use super::TriangleMesh;
use glam::DVec3;

/// Triangles of a leaf.
const LEAF: usize = 6;

/// A box that holds the triangles of a range; its halves are nodes too, unless it is a leaf.
struct Node {
    low: DVec3,
    high: DVec3,
    /// First and last (excluded) triangle, in the order of the tree.
    range: (usize, usize),
    /// The node of the second half; the first follows at once. None of leaves.
    second: Option<usize>,
}

impl Node {
    fn square_distance(&self, p: DVec3) -> f64 {
        (p - p.clamp(self.low, self.high)).length_squared()
    }
}

/// The triangles of a mesh, to be asked for the nearest point of them.
pub struct SurfaceTree<'a> {
    mesh: &'a TriangleMesh,
    /// The triangles, those of a node beside each other.
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl<'a> SurfaceTree<'a> {
    /// The tree of a mesh; none without triangles.
    #[must_use]
    pub fn new(mesh: &'a TriangleMesh) -> Option<Self> {
        let count = u32::try_from(mesh.triangles.len()).ok().filter(|count| *count > 0)?;
        let mut tree = Self { mesh, order: (0..count).collect(), nodes: Vec::new() };
        tree.grow(0, tree.order.len());
        Some(tree)
    }

    /// Adds the node of a range, and those below it.
    fn grow(&mut self, first: usize, last: usize) {
        let mesh = self.mesh;
        let some = &mut self.order[first..last];
        let (low, high) = some
            .iter()
            .flat_map(|t| mesh.corners(*t as usize))
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let place = self.nodes.len();
        self.nodes.push(Node { low, high, range: (first, last), second: None });
        if some.len() <= LEAF {
            return;
        }
        let axis = (high - low).max_position();
        let middle = |t: &u32| mesh.corners(*t as usize).iter().map(|p| p[axis]).sum::<f64>();
        let half = some.len() / 2;
        some.select_nth_unstable_by(half, |a, b| middle(a).total_cmp(&middle(b)).then(a.cmp(b)));
        self.grow(first, first + half);
        self.nodes[place].second = Some(self.nodes.len());
        self.grow(first + half, last);
    }

    /// Distance from a point to the nearest place on a triangle.
    #[must_use]
    pub fn distance(&self, p: DVec3) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut open = vec![(0, self.nodes[0].square_distance(p))];
        while let Some((index, least)) = open.pop() {
            if least >= nearest {
                continue;
            }
            let node = &self.nodes[index];
            if let Some(second) = node.second {
                let halves = [index + 1, second].map(|i| (i, self.nodes[i].square_distance(p)));
                let near = usize::from(halves[1].1 < halves[0].1);
                open.extend([halves[1 - near], halves[near]]);
            } else {
                for t in &self.order[node.range.0..node.range.1] {
                    let there = nearest_on_triangle(p, self.mesh.corners(*t as usize));
                    nearest = nearest.min((p - there).length_squared());
                }
            }
        }
        nearest.sqrt()
    }
}

/// The place on a triangle that is nearest to a point (Ericson, Real-Time Collision Detection, 2005, section 5.1.5).
fn nearest_on_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 > d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 > d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    a + ab * (vb / sum) + ac * (vc / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    /// Against the smallest distance to a dense grid of places on every triangle.
    #[test]
    fn distances_are_those_to_the_nearest_place() {
        let mut random = CounterRng::new(1, 0, 0, 0);
        let mut place = || std::array::from_fn(|_| random.uniform());
        let mesh = TriangleMesh {
            vertices: (0..60).map(|_| place()).collect(),
            triangles: (0..20).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
            ..TriangleMesh::default()
        };
        let tree = SurfaceTree::new(&mesh).unwrap();
        for _ in 0..50 {
            let p = 2.0 * DVec3::from_array(place()) - 0.5;
            let found = tree.distance(p);
            let mut least = f64::INFINITY;
            for t in 0..mesh.triangles.len() {
                let [a, b, c] = mesh.corners(t);
                for i in 0..=100 {
                    for j in 0..=100 - i {
                        let (u, v) = (f64::from(i) / 100.0, f64::from(j) / 100.0);
                        least = least.min((a + u * (b - a) + v * (c - a) - p).length());
                    }
                }
            }
            assert!(found <= least + 1e-12 && least - found < 0.01, "{found} {least}");
        }
        assert!(SurfaceTree::new(&TriangleMesh::default()).is_none());
    }

    #[test]
    fn triangles_without_area_are_lines_and_points() {
        let line = TriangleMesh {
            vertices: vec![[0.0; 3], [2.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
            triangles: vec![[0, 1, 2], [2, 2, 2]],
            ..TriangleMesh::default()
        };
        let tree = SurfaceTree::new(&line).unwrap();
        assert!((tree.distance(DVec3::new(1.5, 0.5, 0.0)) - 0.5).abs() < 1e-12);
        assert!((tree.distance(DVec3::new(4.0, 0.0, 0.0)) - 2.0).abs() < 1e-12);
    }
}
