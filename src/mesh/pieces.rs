//! Connected pieces of a mesh.

use super::TriangleMesh;

/// The number of each triangle's piece. Pieces share no vertex; they are numbered by size, largest first, then by their first
/// triangle. Also returns the number of triangles of each piece.
#[must_use]
pub fn pieces(mesh: &TriangleMesh) -> (Vec<usize>, Vec<usize>) {
    let mut parent: Vec<u32> = (0..mesh.vertices.len() as u32).collect();
    for [a, b, c] in &mesh.triangles {
        for other in [b, c] {
            let (x, y) = (root(&mut parent, *a), root(&mut parent, *other));
            // The lower number is the root, whatever the order of triangles.
            parent[x.max(y) as usize] = x.min(y);
        }
    }
    let mut place = vec![usize::MAX; mesh.vertices.len()];
    let mut sizes: Vec<usize> = Vec::new();
    let mut of_triangle: Vec<usize> = Vec::with_capacity(mesh.triangles.len());
    for [a, ..] in &mesh.triangles {
        let place = &mut place[root(&mut parent, *a) as usize];
        if *place == usize::MAX {
            *place = sizes.len();
            sizes.push(0);
        }
        sizes[*place] += 1;
        of_triangle.push(*place);
    }
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|i| std::cmp::Reverse(sizes[*i]));
    let mut rank = vec![0; sizes.len()];
    order.iter().enumerate().for_each(|(k, i)| rank[*i] = k);
    (of_triangle.iter().map(|i| rank[*i]).collect(), order.iter().map(|i| sizes[*i]).collect())
}

fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
    while parent[vertex as usize] != vertex {
        let above = parent[parent[vertex as usize] as usize];
        parent[vertex as usize] = above;
        vertex = above;
    }
    vertex
}

/// Keeps the `most` largest pieces that have at least `least` triangles; returns how many are kept and how many there were.
pub fn keep_largest_pieces(mesh: &mut TriangleMesh, most: usize, least: usize) -> (usize, usize) {
    let (of_triangle, sizes) = pieces(mesh);
    let kept = sizes.iter().take(most).filter(|size| **size >= least).count();
    let is_kept: Vec<bool> = of_triangle.iter().map(|piece| *piece < kept).collect();
    mesh.retain(&is_kept);
    (kept, sizes.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_pieces_are_kept() {
        let strip = |from: u32, n: u32| (from..from + n).map(|i| [i, i + 1, i + 2]);
        let mesh = TriangleMesh {
            vertices: (0..40).map(|i| [f64::from(i), 0.0, 0.0]).collect(),
            triangles: strip(0, 1).chain(strip(10, 4)).chain(strip(20, 3)).chain(strip(30, 3)).collect(),
            ..TriangleMesh::default()
        };
        assert_eq!(pieces(&mesh).1, [4, 3, 3, 1]);
        let kept = |most, least| {
            let mut mesh = mesh.clone();
            let counts = keep_largest_pieces(&mut mesh, most, least);
            (counts, mesh.triangles.len(), mesh.vertices.len())
        };
        assert_eq!(kept(9, 3), ((3, 4), 10, 16));
        // Of two pieces of the same size the first one is kept.
        assert_eq!(kept(2, 1), ((2, 4), 7, 11));
        assert_eq!(kept(9, 5), ((0, 4), 0, 0));
    }
}
