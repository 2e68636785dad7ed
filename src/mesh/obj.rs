//! Wavefront OBJ files, with colours after the coordinates of a vertex, as MeshLab and Blender read and write them.

use super::TriangleMesh;
use crate::io::{decode_text, georeference_comment, parse_number};
use std::fmt::Write;

/// The file of a mesh.
pub(super) fn bytes(mesh: &TriangleMesh) -> Vec<u8> {
    let mut out = String::new();
    if let Some(site) = &mesh.site {
        let _ = writeln!(out, "# {}", georeference_comment(site));
    }
    for (i, [x, y, z]) in mesh.vertices.iter().enumerate() {
        let _ = write!(out, "v {x} {y} {z}");
        if let Some(color) = mesh.colors.get(i) {
            let [r, g, b] = color.map(|c| f32::from(c) / 255.0);
            let _ = write!(out, " {r:.4} {g:.4} {b:.4}");
        }
        out.push('\n');
    }
    for [x, y, z] in &mesh.normals {
        let _ = writeln!(out, "vn {x} {y} {z}");
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| v + 1);
        let _ = if mesh.normals.is_empty() {
            writeln!(out, "f {a} {b} {c}")
        } else {
            writeln!(out, "f {a}//{a} {b}//{b} {c}//{c}")
        };
    }
    out.into_bytes()
}

/// The mesh of a file: vertices, their colours, normals if there is one for each vertex, and faces.
pub(super) fn parse(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let text = decode_text(bytes);
    let mut mesh = TriangleMesh::default();
    for (number, line) in text.lines().enumerate() {
        let at = |what: String| format!("line {}: {what}", number + 1);
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let numbers = numbers(words).map_err(at)?;
                match *numbers.as_slice() {
                    // The fourth of four numbers is a weight.
                    [x, y, z] | [x, y, z, _] => mesh.vertices.push([x, y, z]),
                    [x, y, z, r, g, b, ..] => {
                        mesh.vertices.push([x, y, z]);
                        mesh.colors.push([r, g, b].map(|v| (v * 255.0).round() as u8));
                    }
                    _ => return Err(at(format!("a vertex has {} numbers", numbers.len()))),
                }
            }
            Some("vn") => match *numbers(words).map_err(at)?.as_slice() {
                [x, y, z] => mesh.normals.push([x, y, z].map(|v| v as f32)),
                _ => return Err(at("a normal does not have three numbers".into())),
            },
            Some("f") => {
                let count = mesh.vertices.len();
                let corners: Vec<u32> =
                    words.map(|w| corner(w, count)).collect::<Result<_, _>>().map_err(at)?;
                let fan = (2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]);
                mesh.triangles.extend(fan);
            }
            _ => {}
        }
    }
    if mesh.colors.len() != mesh.vertices.len() {
        mesh.colors.clear();
    }
    if mesh.normals.len() != mesh.vertices.len() {
        mesh.normals.clear();
    }
    Ok(mesh)
}

fn numbers<'a>(words: impl Iterator<Item = &'a str>) -> Result<Vec<f64>, String> {
    words.map(|w| parse_number(w).ok_or_else(|| format!("`{w}` is not a number"))).collect()
}

/// The vertex of a corner `v`, `v/t`, `v//n` or `v/t/n`; numbers count from 1, negative ones from the last vertex backwards.
fn corner(word: &str, count: usize) -> Result<u32, String> {
    let wrong = || format!("`{word}` names no vertex, there are {count}");
    let number: i64 = word.split('/').next().and_then(|v| v.parse().ok()).ok_or_else(wrong)?;
    let index = if number < 0 { number + count as i64 } else { number - 1 };
    u32::try_from(index).ok().filter(|i| (*i as usize) < count).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_may_count_backwards_and_have_more_than_three_corners() {
        let mesh =
            parse(b"# x\no quad\nv 0 0 0\nv 1 0 0\r\nv 1 1 0\nv 0 1 0\nf -4/1 2/2/2 3//1 4\n").unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert!(mesh.colors.is_empty());
    }

    #[test]
    fn comments_may_have_any_encoding() {
        let mesh = parse(b"# caf\xe9\nv 0 0 0\nvn -nan(ind) 0 1\nf 1 1 1\n").unwrap();
        assert_eq!((mesh.vertices.len(), mesh.normals.len()), (1, 1));
    }

    #[test]
    fn damaged_lines_are_named() {
        for (text, says) in [
            ("v 0 0\n", "line 1: a vertex has 2 numbers"),
            ("v 0 0 x\n", "line 1: `x` is not a number"),
            ("v 0 0 0\nf 1 2 3\n", "line 2: `2` names no vertex, there are 1"),
            ("v 0 0 0\nf 0 1 1\n", "`0` names no vertex"),
            ("v 0 0 0\nf 1 -2 1\n", "`-2` names no vertex"),
            ("v 0 0 0\nf 1 -9223372036854775808 1\n", "names no vertex"),
            ("vn 1\n", "three numbers"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }
}
