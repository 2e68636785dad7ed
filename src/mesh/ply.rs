//! Reading of meshes in PLY files (Turk 1994), binary little-endian or ascii.

use super::TriangleMesh;
use super::ply_header::{Element, Header, Scalar};

/// Names of a face's list of vertices.
const FACE_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The numbers after the header.
enum Body<'a> {
    Binary(&'a [u8]),
    Ascii(std::str::SplitAsciiWhitespace<'a>),
}

impl Body<'_> {
    /// The next number; none at the end, or where there is no number.
    fn next(&mut self, kind: Scalar) -> Option<f64> {
        match self {
            Self::Binary(bytes) => {
                let (number, rest) = bytes.split_at_checked(kind.size())?;
                *bytes = rest;
                kind.value(number)
            }
            Self::Ascii(words) => words.next()?.parse().ok(),
        }
    }
}

/// The mesh of a file. Elements and properties that a mesh does not have are skipped.
pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let header = Header::parse(bytes)?;
    let body = &bytes[header.length..];
    let mut rest = if header.is_ascii {
        let text = std::str::from_utf8(body).map_err(|_| "it is not text, as its header says")?;
        Body::Ascii(text.split_ascii_whitespace())
    } else {
        Body::Binary(body)
    };
    let mut mesh = TriangleMesh::default();
    for element in &header.elements {
        let least = element.least_bytes(header.is_ascii);
        if least == 0 {
            continue;
        }
        let cut = || {
            format!("it announces {} elements `{}`, but ends before the last", element.count, element.name)
        };
        if element.count.checked_mul(least).is_none_or(|need| need > body.len()) {
            return Err(cut());
        }
        match element.name.as_str() {
            "vertex" => read_vertices(&mut rest, element, &mut mesh).ok_or_else(cut)??,
            "face" => read_faces(&mut rest, element, &mut mesh.triangles).ok_or_else(cut)??,
            _ => skip(&mut rest, element).ok_or_else(cut)?,
        }
    }
    Ok(mesh)
}

/// Reads one element; calls `take` with the place of a property and each of its numbers. None at the end of the file.
fn read_element(body: &mut Body, element: &Element, mut take: impl FnMut(usize, f64)) -> Option<()> {
    for (place, property) in element.properties.iter().enumerate() {
        let length = match property.length {
            Some(kind) => body.next(kind)?.max(0.0) as u64,
            None => 1,
        };
        for _ in 0..length {
            take(place, body.next(property.item)?);
        }
    }
    Some(())
}

fn skip(body: &mut Body, element: &Element) -> Option<()> {
    (0..element.count).try_for_each(|_| read_element(body, element, |_, _| {}))
}

/// None at the end of the file, an error if a coordinate is missing.
fn read_vertices(body: &mut Body, element: &Element, mesh: &mut TriangleMesh) -> Option<Result<(), String>> {
    let places = |names: [&str; 3]| {
        let [a, b, c] = names.map(|name| element.place(name));
        Some([a?, b?, c?])
    };
    let Some(position) = places(["x", "y", "z"]) else {
        return Some(Err("its vertices have no x, y and z".into()));
    };
    let (color, normal) = (places(["red", "green", "blue"]), places(["nx", "ny", "nz"]));
    // Colours are bytes, or numbers from 0 to 1, or of 16 bits.
    let scale = color.map_or(1.0, |[red, ..]| match element.properties[red].item {
        Scalar::F32 | Scalar::F64 => 255.0,
        Scalar::U16 => 1.0 / 257.0,
        _ => 1.0,
    });
    let mut values = vec![0.0; element.properties.len()];
    for _ in 0..element.count {
        read_element(body, element, |place, v| values[place] = v)?;
        mesh.vertices.push(position.map(|i| values[i]));
        mesh.colors.extend(color.map(|c| c.map(|i| (values[i] * scale).round() as u8)));
        mesh.normals.extend(normal.map(|n| n.map(|i| values[i] as f32)));
    }
    Some(Ok(()))
}

/// None at the end of the file, an error if a face has no list of vertices.
fn read_faces(
    body: &mut Body,
    element: &Element,
    triangles: &mut Vec<[u32; 3]>,
) -> Option<Result<(), String>> {
    let Some(list) = FACE_LISTS.iter().find_map(|name| element.place(name)) else {
        return Some(Err("its faces have no list `vertex_indices`".into()));
    };
    let mut face = Vec::new();
    for number in 0..element.count {
        face.clear();
        read_element(body, element, |place, v| {
            if place == list {
                face.push(v);
            }
        })?;
        if let Some(v) = face.iter().find(|v| !(0.0..f64::from(u32::MAX)).contains(*v)) {
            return Some(Err(format!("face {number} names vertex {v}")));
        }
        let corner = |k: usize| face[k] as u32;
        triangles.extend((2..face.len()).map(|k| [corner(0), corner(k - 1), corner(k)]));
    }
    Some(Ok(()))
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
            ("9 4 0 1 2 3", "9 4 0 1 2 x", "ends before the last"),
            ("9 4 0 1 2 3", "9 4 0 1 2 NaN", "face 0 names vertex NaN"),
            ("ply", "obj", "does not begin with `ply`"),
            ("end_header", "end", "no `end_header`"),
        ] {
            let error = parse(QUAD.replacen(from, to, 1).as_bytes()).unwrap_err();
            assert!(error.contains(says), "{from} -> {to}: {error}");
        }
    }
}
