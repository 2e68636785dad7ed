//! Splat files: the PLY format of 3DGS, which splat viewers open, with the georeference in a JSON file beside it. Discs have the
//! columns of 2DGS: no third scale, and their normals.

use crate::frame::SiteGrid;
use crate::io::{
    WriteError, decode_text, georeference_comment, remove_if_there, write_file, write_georeference,
};
use crate::splat::primitive::{FLAT_LOG_SCALE, PrimitiveKind};
use crate::splat::splats::{GROUP_INFO, GroupInfo, Splats, unit_quaternion};
use glam::{Quat, Vec3};
use std::fmt::Write as _;
use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Columns that 3DGS writes after the position: the normals of discs, zero for ellipsoids.
const NORMALS: [&str; 3] = ["nx", "ny", "nz"];
/// Bytes within which a header ends: that of splats has about 2 KB.
const LARGEST_HEADER: u64 = 1 << 16;
/// The group whose last column discs lack.
const SCALES: &str = "log_scale";

/// Which columns the scales have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScaleColumns {
    /// Two of discs (2DGS), three of ellipsoids (3DGS).
    OfPrimitive,
    /// Three, for programs that know only ellipsoids.
    Three,
}

/// The parameter groups that splats have, in the order of the columns (that of 3DGS), and the values of each.
fn groups_of(splats: &Splats) -> impl Iterator<Item = (GroupInfo, &[f32])> {
    GROUP_INFO
        .into_iter()
        .zip(splats.groups())
        .filter(|(info, values)| !(info.is_optional && values.is_empty()))
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
    write_file(path, encode(splats, site, ScaleColumns::OfPrimitive))?;
    write_georeference(path, site)
}

/// The content of a PLY file of splats in the site frame (metres).
#[must_use]
pub fn encode(splats: &Splats, site: &SiteGrid, scales: ScaleColumns) -> Vec<u8> {
    let comment = georeference_comment(site);
    // The format does not define the vertical axis; viewers read it from this comment.
    encoded(splats, scales, &[&comment, "Vertical Axis: z"])
}

/// Writes splats as a PLY file in a frame that has no place on Earth.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_local(path: &Path, splats: &Splats) -> Result<(), WriteError> {
    write_file(path, encode_local(splats, ScaleColumns::OfPrimitive))?;
    // That of earlier splats is not theirs.
    remove_if_there(&path.with_extension("georef.json"))
}

/// The content of a PLY file of splats in a frame that has no place on Earth.
#[must_use]
pub fn encode_local(splats: &Splats, scales: ScaleColumns) -> Vec<u8> {
    encoded(splats, scales, &["satgs frame of the cameras"])
}

/// The bytes of a PLY file.
fn encoded(splats: &Splats, scales: ScaleColumns, comments: &[&str]) -> Vec<u8> {
    let is_disc = splats.primitive() == PrimitiveKind::Disc;
    let is_flat = is_disc && scales == ScaleColumns::OfPrimitive;
    let columns_of = |info: &GroupInfo| info.width - usize::from(is_flat && info.name == SCALES);
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    for comment in comments {
        let _ = writeln!(header, "comment {comment}");
    }
    let _ = writeln!(header, "element vertex {}", splats.len());
    let mut stride = 0;
    for (g, (info, _)) in groups_of(splats).enumerate() {
        let normals = NORMALS.iter().filter(|_| g == 0);
        for name in info.ply[..columns_of(&info)].iter().chain(normals) {
            let _ = writeln!(header, "property float {name}");
            stride += 4;
        }
    }
    header.push_str("end_header\n");
    let mut bytes = header.into_bytes();
    bytes.reserve(splats.len() * stride);
    for i in 0..splats.len() {
        for (g, (info, values)) in groups_of(splats).enumerate() {
            for value in &values[i * info.width..][..columns_of(&info)] {
                bytes.extend_from_slice(&value.to_le_bytes());
            }
            if g == 0 {
                let normal = if is_disc { normal(splats.rotation[i]) } else { [0.0; NORMALS.len()] };
                normal.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
            }
        }
    }
    bytes
}

/// The normal of a disc: its third axis.
fn normal(rotation: [f32; 4]) -> [f32; 3] {
    let [w, x, y, z] = unit_quaternion(rotation);
    (Quat::from_xyzw(x, y, z, w) * Vec3::Z).to_array()
}

/// The columns of coefficients above degree 0 that a file has, each with its place in `f_rest`. Files of lower degrees have
/// fewer for each channel.
fn rest_columns(properties: &[String]) -> Option<Vec<(usize, usize)>> {
    let rest = |name: &String| name.strip_prefix("f_rest_").and_then(|k| k.parse::<usize>().ok());
    let found: Vec<(usize, usize)> =
        properties.iter().enumerate().filter_map(|(column, name)| Some((column, rest(name)?))).collect();
    let of_channel = found.len() / 3;
    let is_degree = [0, 3, 8, 15].contains(&of_channel) && found.len() == 3 * of_channel;
    let is_whole = (0..found.len()).all(|k| found.iter().filter(|f| f.1 == k).count() == 1);
    (is_degree && is_whole).then(|| {
        found.into_iter().map(|(column, k)| (column, k / of_channel * 15 + k % of_channel)).collect()
    })
}

/// Where the numbers of a splat file are: a table of little-endian float32, a row for each splat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlyTable {
    /// Bytes before the first row.
    pub offset: usize,
    /// Number of rows.
    pub rows: usize,
    /// Names of the columns.
    pub columns: Vec<String>,
}

impl PlyTable {
    /// Finds the table of a file from its header alone.
    ///
    /// # Errors
    /// [`PlyError`] if the file cannot be read, is cut off, or holds no such table.
    pub fn of(path: &Path) -> Result<Self, PlyError> {
        let unreadable = |e: std::io::Error| PlyError::Io { path: path.into(), reason: e.to_string() };
        let file = std::fs::File::open(path).map_err(unreadable)?;
        let length = file.metadata().map_err(unreadable)?.len();
        let mut head = Vec::new();
        file.take(LARGEST_HEADER).read_to_end(&mut head).map_err(unreadable)?;
        Self::parse(path, &head, length)
    }

    /// Reads the header from the first bytes of a file of `length` bytes.
    fn parse(path: &Path, bytes: &[u8], length: u64) -> Result<Self, PlyError> {
        let refused = |reason: &str| PlyError::Format { path: path.into(), reason: reason.into() };
        const END: &[u8] = b"end_header\n";
        let end =
            bytes.windows(END.len()).position(|w| w == END).ok_or_else(|| refused("it has no PLY header"))?;
        let header = decode_text(&bytes[..end]);
        if !header.contains("format binary_little_endian 1.0") {
            return Err(refused("it is not binary little-endian"));
        }
        let mut count = None;
        let mut columns = Vec::new();
        for line in header.lines() {
            let words: Vec<&str> = line.split_whitespace().collect();
            match words.as_slice() {
                ["element", "vertex", n] => count = n.parse::<usize>().ok(),
                ["element", ..] if count.is_some() => break,
                ["property", "float" | "float32", name] => columns.push((*name).to_owned()),
                ["property", ..] => return Err(refused("a vertex property is not a float")),
                _ => {}
            }
        }
        let rows = count.ok_or_else(|| refused("it has no vertex element"))?;
        if columns.is_empty() {
            return Err(refused("its vertices have no properties"));
        }
        let offset = end + END.len();
        let need = rows.checked_mul(4 * columns.len()).map(|body| body as u64);
        if need.is_none_or(|need| need > length.saturating_sub(offset as u64)) {
            return Err(refused(&format!(
                "its header announces {rows} vertices, but the file ends before the last"
            )));
        }
        Ok(Self { offset, rows, columns })
    }
}

/// Reads splats that [`write()`] or another 3DGS program wrote, with spherical harmonics of any degree up to 3. Properties that
/// splats do not have are ignored. Splats without a third scale are discs. If all spherical harmonics above degree 0 are zero, the splats have none.
///
/// # Errors
/// [`PlyError`] if the file cannot be read, is cut off, lacks a property, or has values that are not finite.
pub fn read(path: &Path) -> Result<Splats, PlyError> {
    let bytes = std::fs::read(path).map_err(|e| PlyError::Io { path: path.into(), reason: e.to_string() })?;
    decode(path, &bytes)
}

/// As [`read`], of the content of a file, which errors name.
///
/// # Errors
/// As [`read`].
pub fn decode(path: &Path, bytes: &[u8]) -> Result<Splats, PlyError> {
    let refused = |reason: &str| PlyError::Format { path: path.into(), reason: reason.into() };
    let PlyTable { offset, rows: count, columns: properties } =
        PlyTable::parse(path, bytes, bytes.len() as u64)?;
    let stride = 4 * properties.len();
    let body = &bytes[offset..];
    let at = |name: &str| {
        let column = properties.iter().position(|p| p == name);
        column.map(|c| 4 * c).ok_or_else(|| refused(&format!("property `{name}` is missing")))
    };
    let value = |vertex: &[u8], offset: usize| {
        f32::from_le_bytes([vertex[offset], vertex[offset + 1], vertex[offset + 2], vertex[offset + 3]])
    };
    let vertices = || body.chunks_exact(stride).take(count);
    let rest = rest_columns(&properties)
        .ok_or_else(|| refused("its `f_rest_*` are not those of spherical harmonics of degree 1, 2 or 3"))?;
    let mut out = Splats::zeros(count);
    let is_zero = |vertex: &[u8]| rest.iter().all(|(column, _)| value(vertex, 4 * column) == 0.0);
    if !vertices().all(is_zero) {
        out.f_rest.resize(count, [0.0; 45]);
        for (vertex, values) in vertices().zip(&mut out.f_rest) {
            rest.iter().for_each(|(column, k)| values[*k] = value(vertex, 4 * column));
        }
    }
    for (values, info) in out.groups_mut().into_iter().zip(GROUP_INFO).filter(|(_, info)| !info.is_optional) {
        let is_flat = info.name == SCALES && at(info.ply[info.width - 1]).is_err();
        let present = &info.ply[..info.width - usize::from(is_flat)];
        let offsets = present.iter().map(|name| at(name)).collect::<Result<Vec<_>, _>>()?;
        for (vertex, values) in vertices().zip(values.chunks_exact_mut(info.width)) {
            values[info.width - 1] = FLAT_LOG_SCALE;
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

    #[test]
    fn discs_are_written_with_two_scales_and_their_normals() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("splats.ply");
        let mut g = Splats::default();
        g.push([1.0, 2.0, 3.0], 0.5, 0.3, [0.1, 0.2, 0.3]);
        g.rotation[0] = [0.5, 0.5, 0.5, 0.5];
        g.flatten();
        write_local(&path, &g).unwrap();
        assert_eq!(read(&path).unwrap(), g);
        let bytes = encode_local(&g, ScaleColumns::OfPrimitive);
        assert!(!String::from_utf8_lossy(&bytes).contains("scale_2"));
        // A turn that takes x to y, y to z and z to x.
        let first: Vec<f32> = bytes[bytes.len() - 4 * 16..]
            .chunks(4)
            .map(|v| f32::from_le_bytes(v.try_into().unwrap()))
            .collect();
        assert_eq!(first[..6], [1.0, 2.0, 3.0, 1.0, 0.0, 0.0]);
        assert!(String::from_utf8_lossy(&encode_local(&g, ScaleColumns::Three)).contains("scale_2"));
    }

    #[test]
    fn spherical_harmonics_are_written_channel_by_channel_and_read_in_any_degree() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("splats.ply");
        let mut g = Splats::default();
        g.push([1.0, 2.0, 3.0], 0.1, 0.3, [0.1, 0.2, 0.9]);
        g.push([3.0, 2.0, 1.0], 0.1, 0.3, [0.1, 0.2, 0.9]);
        g.f_rest = vec![std::array::from_fn(|k| k as f32 + 0.5), [0.0; 45]];
        write_local(&path, &g).unwrap();
        assert_eq!(read(&path).unwrap(), g);
        assert!(!dir.path().join("splats.georef.json").exists());
        let bytes = std::fs::read(&path).unwrap();
        let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
        let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let names: Vec<&str> =
            header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
        assert_eq!(names[..10], ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "f_rest_0"]);
        assert_eq!((names.len(), names[53], names[54]), (62, "f_rest_44", "opacity"));
        // Of degree 1 each channel has three coefficients.
        let without = |dropped: &dyn Fn(usize) -> bool| {
            let kept =
                |c: &usize| !names[*c].strip_prefix("f_rest_").is_some_and(|k| dropped(k.parse().unwrap()));
            let mut header: String =
                header.lines().filter(|l| !l.contains("property")).flat_map(|l| [l, "\n"]).collect();
            (0..62).filter(&kept).for_each(|c| header += &format!("property float {}\n", names[c]));
            let mut out = (header + "end_header\n").into_bytes();
            for vertex in bytes[end + 11..].chunks(4 * 62) {
                (0..62).filter(&kept).for_each(|c| out.extend(&vertex[4 * c..4 * c + 4]));
            }
            std::fs::write(&path, out).unwrap();
            read(&path)
        };
        let low = without(&|k| k >= 9).unwrap().f_rest[0];
        assert_eq!((low[0], low[2], low[3], low[15], low[17], low[30]), (0.5, 2.5, 0.0, 3.5, 5.5, 6.5));
        assert!(without(&|k| k == 7).unwrap_err().to_string().contains("f_rest"));
        assert!(without(&|_| true).unwrap().f_rest.is_empty());
    }
}
