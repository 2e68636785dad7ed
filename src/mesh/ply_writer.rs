//! Writing of meshes as binary PLY files (Turk 1994).

use super::TriangleMesh;
use crate::io::georeference_comment;
use std::fmt::Write;

/// The file of a mesh.
pub(super) fn bytes(mesh: &TriangleMesh) -> Vec<u8> {
    // Coordinates of a map need double precision.
    let is_far = mesh.is_far();
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    if let Some(site) = &mesh.site {
        let _ = writeln!(header, "comment {}", georeference_comment(site));
    }
    let _ = writeln!(header, "element vertex {}", mesh.vertices.len());
    let mut columns = |kind: &str, names: [&str; 3]| {
        names.iter().for_each(|name| header += &format!("property {kind} {name}\n"));
    };
    columns(if is_far { "double" } else { "float" }, ["x", "y", "z"]);
    if !mesh.normals.is_empty() {
        columns("float", ["nx", "ny", "nz"]);
    }
    if !mesh.colors.is_empty() {
        columns("uchar", ["red", "green", "blue"]);
    }
    let _ = writeln!(header, "element face {}", mesh.triangles.len());
    header.push_str("property list uchar int vertex_indices\nend_header\n");
    let mut out = header.into_bytes();
    out.reserve(mesh.vertices.len() * 39 + mesh.triangles.len() * 13);
    for (i, p) in mesh.vertices.iter().enumerate() {
        for v in p {
            if is_far {
                out.extend(v.to_le_bytes());
            } else {
                out.extend((*v as f32).to_le_bytes());
            }
        }
        out.extend(mesh.normals.get(i).into_iter().flatten().flat_map(|v| v.to_le_bytes()));
        out.extend(mesh.colors.get(i).into_iter().flatten());
    }
    for triangle in &mesh.triangles {
        out.push(3);
        out.extend(triangle.iter().flat_map(|v| v.to_le_bytes()));
    }
    out
}
