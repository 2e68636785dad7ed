//! Splat files: the PLY format of 3DGS, which splat viewers open, with the georeference in a JSON file beside it.

use crate::frame::SiteGrid;
use crate::io::{WriteError, georeference_comment, write_file, write_georeference};
use crate::splat::splats::{GROUP_INFO, Splats};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Columns that 3DGS writes after the position; their values are zero.
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];

/// The columns of a vertex, all float32, in the order of 3DGS (spherical harmonics of degree 0).
fn columns() -> impl Iterator<Item = &'static str> {
    let [position, others @ ..] = &GROUP_INFO;
    position.ply.iter().chain(&NORMALS).chain(others.iter().flat_map(|group| group.ply)).copied()
}

/// Why a splat file could not be read.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum PlyError {
    /// The file cannot be read.
    #[error("`{path}` cannot be read: {reason}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's message.
        reason: String,
    },
    /// The file is not a supported splat file.
    #[error("`{path}` is not a supported splat file: {reason}")]
    #[diagnostic(help("expected a binary little-endian PLY of float32 3DGS properties"))]
    Format {
        /// The file.
        path: PathBuf,
        /// The reason.
        reason: String,
    },
}

/// Writes splats as a PLY file in the site frame (metres), and the frame's georeference as `NAME.georef.json` beside it.
///
/// # Errors
/// [`WriteError`] if one of the files cannot be written.
pub fn write(path: &Path, splats: &Splats, site: &SiteGrid) -> Result<(), WriteError> {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    let _ = writeln!(header, "comment {}", georeference_comment(site));
    // The format does not define the vertical axis; viewers read it from this comment.
    header.push_str("comment Vertical Axis: z\n");
    let _ = writeln!(header, "element vertex {}", splats.len());
    for name in columns() {
        let _ = writeln!(header, "property float {name}");
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    bytes.reserve(splats.len() * columns().count() * 4);
    let groups = splats.groups();
    for i in 0..splats.len() {
        for (g, (values, info)) in groups.iter().zip(GROUP_INFO).enumerate() {
            for value in &values[i * info.width..(i + 1) * info.width] {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
            if g == 0 {
                bytes.extend_from_slice(&[0; 4 * NORMALS.len()]);
            }
        }
    }
    write_file(path, bytes)?;
    write_georeference(path, site)
}

/// Reads splats that [`write()`] or another 3DGS program wrote. Properties that splats do not have are ignored.
///
/// # Errors
/// [`PlyError`] if the file cannot be read, is cut off, lacks a property, or has values that are not finite or spherical
/// harmonics above degree 0.
pub fn read(path: &Path) -> Result<Splats, PlyError> {
    let bytes = std::fs::read(path).map_err(|e| PlyError::Io { path: path.into(), reason: e.to_string() })?;
    let refused = |reason: &str| PlyError::Format { path: path.into(), reason: reason.into() };
    const END: &[u8] = b"end_header\n";
    let end =
        bytes.windows(END.len()).position(|w| w == END).ok_or_else(|| refused("it has no PLY header"))?;
    let header = std::str::from_utf8(&bytes[..end]).map_err(|_| refused("its header is not text"))?;
    if !header.contains("format binary_little_endian 1.0") {
        return Err(refused("it is not binary little-endian"));
    }
    let mut count = None;
    let mut properties = Vec::new();
    for line in header.lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["element", "vertex", n] => count = n.parse::<usize>().ok(),
            ["element", ..] if count.is_some() => break,
            ["property", "float" | "float32", name] => properties.push((*name).to_owned()),
            ["property", ..] => return Err(refused("a vertex property is not a float")),
            _ => {}
        }
    }
    let count = count.ok_or_else(|| refused("it has no vertex element"))?;
    let stride = 4 * properties.len();
    let body = &bytes[end + END.len()..];
    if count.checked_mul(stride).is_none_or(|need| need > body.len()) {
        return Err(refused(&format!(
            "its header announces {count} vertices, but the file ends before the last"
        )));
    }
    let at = |name: &str| {
        let column = properties.iter().position(|p| p == name);
        column.map(|c| 4 * c).ok_or_else(|| refused(&format!("property `{name}` is missing")))
    };
    let value = |vertex: &[u8], offset: usize| {
        f32::from_le_bytes([vertex[offset], vertex[offset + 1], vertex[offset + 2], vertex[offset + 3]])
    };
    let vertices = || body.chunks_exact(stride).take(count);
    // Colours that depend on the viewing direction would be lost.
    let rest: Vec<usize> =
        (0..properties.len()).filter(|k| properties[*k].starts_with("f_rest_")).map(|k| 4 * k).collect();
    if vertices().any(|vertex| rest.iter().any(|offset| value(vertex, *offset) != 0.0)) {
        return Err(refused(
            "it has spherical harmonics above degree 0 (`f_rest_*`), which are not supported",
        ));
    }
    let mut out = Splats::zeros(count);
    for (values, info) in out.groups_mut().into_iter().zip(GROUP_INFO) {
        let offsets = info.ply.iter().map(|name| at(name)).collect::<Result<Vec<_>, _>>()?;
        for (vertex, values) in vertices().zip(values.chunks_exact_mut(info.width)) {
            for (value_of_splat, offset) in values.iter_mut().zip(&offsets) {
                *value_of_splat = value(vertex, *offset);
            }
        }
    }
    if out.groups().iter().any(|g| g.iter().any(|v| !v.is_finite())) {
        return Err(refused("a value of a splat is not finite"));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Point;

    #[test]
    fn written_splats_are_read_back_equal_and_a_truncated_file_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("splats.ply");
        let mut g = Splats::default();
        for i in 0..50 {
            let v = i as f32;
            g.push([v, -v, 0.5 * v], 0.1 + v, 0.3, [0.1, 0.2, v / 50.0]);
        }
        let site = SiteGrid { epsg: 32617, origin: Point::new(436_211.9, 3_357_611.8, -20.0) };
        write(&path, &g, &site).unwrap();
        assert_eq!(read(&path).unwrap(), g);
        assert!(dir.path().join("splats.georef.json").exists());
        let bytes = std::fs::read(&path).unwrap();
        let header = String::from_utf8_lossy(&bytes[..300]).into_owned();
        assert!(header.lines().any(|line| line == "comment Vertical Axis: z"), "{header}");
        for part in 0..100 {
            std::fs::write(&path, &bytes[..bytes.len() * part / 100]).unwrap();
            assert!(matches!(read(&path), Err(PlyError::Format { .. })));
        }
    }
}
