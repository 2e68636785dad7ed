//! Meshes in PLY files (Turk 1994), binary little-endian or ascii.

use super::TriangleMesh;
use crate::io::PlyContent;

/// The mesh of a file. Elements and properties that a mesh does not have are skipped.
pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let PlyContent { vertices, colors, normals, triangles } = PlyContent::parse(bytes)?;
    Ok(TriangleMesh { vertices, colors, normals, triangles, ..TriangleMesh::default() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::file::tests::tetrahedron;
    use crate::mesh::ply_writer;
    use crate::random::CounterRng;

    const QUAD: &str = "ply\nformat ascii 1.0\ncomment by hand\nelement camera 1\nproperty list uchar int k\n\
        element vertex 4\nproperty double x\nproperty float y\nproperty float z\nproperty float red\n\
        property float green\nproperty float blue\nelement face 1\nproperty uchar flag\n\
        property list uchar int vertex_index\nend_header\n2 7 8\n0 0 0 1 0.5 0\n1 0 0 1 0.5 0\n1 1 0 1 0.5 0\n\
        0 1 0 1 0.5 0\n9 4 0 1 2 3\n";

    #[test]
    fn polygons_become_triangles_and_other_properties_are_skipped() {
        let mesh = parse(QUAD.as_bytes()).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.vertices[2], [1.0, 1.0, 0.0]);
        assert_eq!(mesh.colors, [[255, 128, 0]; 4]);
        assert!(mesh.normals.is_empty());
    }

    #[test]
    fn texts_of_other_programs_are_read() {
        let text =
            QUAD.replace("by hand", "caf\u{e9}").replacen("0 0 0 1 0.5 0", "0 0 0 -nan(ind) 1.#INF 0", 1);
        let latin1: Vec<u8> = text.chars().map(|c| c as u8).collect();
        let mesh = parse(&latin1).unwrap();
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (4, 2));
    }

    #[test]
    fn a_file_cut_at_any_place_is_an_error() {
        let bytes = ply_writer::bytes(&tetrahedron());
        for length in 0..bytes.len() {
            assert!(parse(&bytes[..length]).is_err(), "{length}");
        }
    }

    #[test]
    fn files_with_wrong_bytes_are_read_or_refused() {
        for (k, good) in [QUAD.as_bytes().to_vec(), ply_writer::bytes(&tetrahedron())].iter().enumerate() {
            for step in 0..3000 {
                let mut draw = CounterRng::new(0, k as u64, step, 0);
                let mut bytes = good.clone();
                for _ in 0..1 + draw.below(4) {
                    let at = draw.below(bytes.len());
                    bytes[at] = draw.below(256) as u8;
                }
                let _ = parse(&bytes);
            }
        }
    }

    #[test]
    fn damaged_headers_are_errors_that_say_what_is_wrong() {
        for (from, to, says) in [
            ("vertex 4", "vertex 4000000000000000000", "announces 4000000000000000000 elements"),
            ("vertex 4", "vertex -4", "announces `-4` elements"),
            ("format ascii", "format binary_big_endian", "its format is `binary_big_endian`"),
            ("property float y\n", "", "no x, y and z"),
            ("float y", "quad y", "the type `quad`"),
            ("vertex_index", "corners", "no list `vertex_indices`"),
            ("9 4 0 1 2 3", "9 4 0 1 2 -3", "face 0 names vertex -3"),
            ("9 4 0 1 2 3", "9 4 0 1 2 x", "`x` stands in place of a number of an element `face`"),
            ("9 4 0 1 2 3", "9 4 0 1 2", "ends before the last"),
            ("9 4 0 1 2 3", "9 4 0 1 2 NaN", "face 0 names vertex NaN"),
            ("ply", "obj", "does not begin with `ply`"),
            ("end_header", "end", "no `end_header`"),
        ] {
            let error = parse(QUAD.replacen(from, to, 1).as_bytes()).unwrap_err();
            assert!(error.contains(says), "{from} -> {to}: {error}");
        }
    }
}
