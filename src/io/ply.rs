//! Reading of points and meshes in PLY files (Turk 1994), binary little-endian or ascii.

use super::ply_header::{Element, Header, Scalar};
use super::{decode_text, parse_number};

/// The points or the mesh of a PLY file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PlyContent {
    /// Coordinates of the vertices.
    pub vertices: Vec<[f64; 3]>,
    /// Red, green and blue of each vertex; empty if the file has no colours.
    pub colors: Vec<[u8; 3]>,
    /// A normal for each vertex; empty if the file has none.
    pub normals: Vec<[f32; 3]>,
    /// Indices of three vertices; polygons are cut into triangles.
    pub triangles: Vec<[u32; 3]>,
}

/// Names of a face's list of vertices.
const FACE_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The numbers after the header.
enum Body<'a> {
    Binary(&'a [u8]),
    Ascii(std::str::SplitAsciiWhitespace<'a>),
}

/// Why the next number cannot be read.
enum Fault {
    /// The file ends.
    End,
    /// What stands there.
    Word(String),
    /// What is wrong with the element.
    Element(String),
}

impl Body<'_> {
    /// The next number.
    fn next(&mut self, kind: Scalar) -> Result<f64, Fault> {
        match self {
            Self::Binary(bytes) => {
                let (number, rest) = bytes.split_at_checked(kind.size()).ok_or(Fault::End)?;
                *bytes = rest;
                kind.value(number).ok_or(Fault::End)
            }
            Self::Ascii(words) => {
                let word = words.next().ok_or(Fault::End)?;
                parse_number(word).ok_or_else(|| Fault::Word(word.to_owned()))
            }
        }
    }
}

impl PlyContent {
    /// Parses a file. Elements and properties that a mesh does not have are skipped.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        let header = Header::parse(bytes)?;
        let body = &bytes[header.length..];
        let text = if header.is_ascii { decode_text(body) } else { String::new() };
        let mut rest =
            if header.is_ascii { Body::Ascii(text.split_ascii_whitespace()) } else { Body::Binary(body) };
        let mut mesh = Self::default();
        for element in &header.elements {
            let least = element.least_bytes(header.is_ascii);
            if least == 0 {
                continue;
            }
            let cut = || {
                format!(
                    "it announces {} elements `{}`, but ends before the last",
                    element.count, element.name
                )
            };
            if element.count.checked_mul(least).is_none_or(|need| need > body.len()) {
                return Err(cut());
            }
            let read = match element.name.as_str() {
                "vertex" => read_vertices(&mut rest, element, &mut mesh),
                "face" => read_faces(&mut rest, element, &mut mesh.triangles),
                _ => skip(&mut rest, element),
            };
            read.map_err(|fault| match fault {
                Fault::End => cut(),
                Fault::Word(word) => {
                    format!("`{word}` stands in place of a number of an element `{}`", element.name)
                }
                Fault::Element(reason) => reason,
            })?;
        }
        Ok(mesh)
    }
}

/// Reads one element; calls `take` with the place of a property and each of its numbers.
fn read_element(body: &mut Body, element: &Element, mut take: impl FnMut(usize, f64)) -> Result<(), Fault> {
    for (place, property) in element.properties.iter().enumerate() {
        let length = match property.length {
            Some(kind) => body.next(kind)?.max(0.0) as u64,
            None => 1,
        };
        for _ in 0..length {
            take(place, body.next(property.item)?);
        }
    }
    Ok(())
}

fn skip(body: &mut Body, element: &Element) -> Result<(), Fault> {
    (0..element.count).try_for_each(|_| read_element(body, element, |_, _| {}))
}

fn read_vertices(body: &mut Body, element: &Element, mesh: &mut PlyContent) -> Result<(), Fault> {
    let places = |names: [&str; 3]| {
        let [a, b, c] = names.map(|name| element.place(name));
        Some([a?, b?, c?])
    };
    let position =
        places(["x", "y", "z"]).ok_or_else(|| Fault::Element("its vertices have no x, y and z".into()))?;
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
    Ok(())
}

fn read_faces(body: &mut Body, element: &Element, triangles: &mut Vec<[u32; 3]>) -> Result<(), Fault> {
    let list = FACE_LISTS.iter().find_map(|name| element.place(name));
    let list = list.ok_or_else(|| Fault::Element("its faces have no list `vertex_indices`".into()))?;
    let mut face = Vec::new();
    for number in 0..element.count {
        face.clear();
        read_element(body, element, |place, v| {
            if place == list {
                face.push(v);
            }
        })?;
        if let Some(v) = face.iter().find(|v| !(0.0..f64::from(u32::MAX)).contains(*v)) {
            return Err(Fault::Element(format!("face {number} names vertex {v}")));
        }
        let corner = |k: usize| face[k] as u32;
        triangles.extend((2..face.len()).map(|k| [corner(0), corner(k - 1), corner(k)]));
    }
    Ok(())
}
