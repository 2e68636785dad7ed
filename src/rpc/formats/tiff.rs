//! The TIFF tag 50844 (`RPCCoefficientTag`): 92 doubles.
//!
//! GDAL returns the values as text of 15 digits; this module reads all bits. The layout is in "RPCs in GeoTIFF"
//! (<http://geotiff.maptools.org/rpc_prop.html>).

use super::FormatError;
use super::keys::in_file_order;
use crate::io::vsi;
use crate::rpc::model::TERMS;
use crate::rpc::{Axis, Rpc, RpcError};
use std::array::from_fn;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Number of the tag.
const RPC_COEFFICIENTS: u16 = 50844;
/// TIFF type of its values, IEEE double.
const DOUBLE: u16 = 12;
/// Number of its values.
const COUNT: usize = 92;
/// Largest number of entries of an image file directory that is read.
const MAX_ENTRIES: u64 = 4096;

/// The camera in the tag of a TIFF file; `None` if the file is not a TIFF, has no such tag, or cannot be read.
///
/// # Errors
/// [`FormatError::Invalid`] if the values are not a valid RPC.
pub fn from_tiff(file: &Path) -> Result<Option<Rpc>, FormatError> {
    vsi::open(file).map_or(Ok(None), |content| parse_tiff(file, content))
}

/// Parses the content of a TIFF file as [`from_tiff`] does; `file` names it in messages.
///
/// # Errors
/// As [`from_tiff`].
pub fn parse_tiff(file: &Path, content: impl Read + Seek) -> Result<Option<Rpc>, FormatError> {
    let Some(values) = read_tag(content) else { return Ok(None) };
    camera(&values).map(Some).map_err(|e| FormatError::invalid(file, e))
}

/// The values of the tag; `None` unless there are 92 doubles.
fn read_tag(mut file: impl Read + Seek) -> Option<[f64; COUNT]> {
    let mut head = [0; 8];
    file.read_exact(&mut head).ok()?;
    let little = match &head[..2] {
        b"II" => true,
        b"MM" => false,
        _ => return None,
    };
    let mut tiff = Tiff { file, little };
    // A BigTIFF (43) has 64-bit offsets and counts.
    let big = match tiff.number(&head[2..4]) {
        42 => false,
        43 => true,
        _ => return None,
    };
    let (entry, count_bytes) = if big { (20, 8) } else { (12, 2) };
    let directory = if big { tiff.number_at(8, 8)? } else { tiff.number(&head[4..8]) };
    let entries = tiff.number_at(directory, count_bytes)?.min(MAX_ENTRIES);
    let first = directory.checked_add(count_bytes as u64)?;
    let mut bytes = vec![0; entry];
    for i in 0..entries {
        tiff.read_at(first.checked_add(i * entry as u64)?, &mut bytes)?;
        let field = |tiff: &Tiff<_>, from: usize, to: usize| tiff.number(&bytes[from..to]);
        if field(&tiff, 0, 2) != u64::from(RPC_COEFFICIENTS) {
            continue;
        }
        let value = if big { 12 } else { 8 };
        if field(&tiff, 2, 4) != u64::from(DOUBLE) || field(&tiff, 4, value) != COUNT as u64 {
            return None;
        }
        let offset = field(&tiff, value, entry);
        let mut doubles = [0; 8 * COUNT];
        tiff.read_at(offset, &mut doubles)?;
        return Some(from_fn(|k| f64::from_bits(tiff.number(&doubles[8 * k..8 * k + 8]))));
    }
    None
}

/// A TIFF file and its byte order.
struct Tiff<F> {
    file: F,
    little: bool,
}

impl<F: Read + Seek> Tiff<F> {
    fn read_at(&mut self, offset: u64, bytes: &mut [u8]) -> Option<()> {
        self.file.seek(SeekFrom::Start(offset)).ok()?;
        self.file.read_exact(bytes).ok()
    }

    fn number_at(&mut self, offset: u64, size: usize) -> Option<u64> {
        let mut bytes = [0; 8];
        self.read_at(offset, &mut bytes[..size])?;
        Some(self.number(&bytes[..size]))
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        let append = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
        if self.little { bytes.iter().rev().fold(0, append) } else { bytes.iter().fold(0, append) }
    }
}

fn camera(v: &[f64; COUNT]) -> Result<Rpc, RpcError> {
    let axis = |k: usize| Axis { offset: v[2 + k], scale: v[7 + k] };
    let terms = |k: usize| from_fn(|i| v[12 + TERMS * k + i]);
    in_file_order(from_fn(axis), from_fn(terms), [v[0], v[1]])
}
