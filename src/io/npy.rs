//! Arrays of numbers in NumPy's `.npy` files (NumPy Enhancement Proposal 1).

use super::error::{ReadError, WriteError};
use super::{Grid2, NumberKind, vsi, write_file};
use std::path::Path;

/// First bytes of a file, before its version.
const MAGIC: &[u8] = b"\x93NUMPY";
/// The header ends at a multiple of this many bytes.
const ALIGNMENT: usize = 64;
/// Largest number of values that is read: a damaged header may ask for any.
const MOST_VALUES: usize = 1 << 30;

/// An array of numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NpyArray {
    /// Number of values along each axis; the last axis changes fastest.
    pub shape: Vec<usize>,
    /// The values, as f32.
    pub values: Vec<f32>,
    /// The type of the numbers in the file.
    pub kind: NumberKind,
}

/// A raster as rows of columns.
impl From<Grid2> for NpyArray {
    fn from(raster: Grid2) -> Self {
        Self { shape: vec![raster.height, raster.width], values: raster.data, kind: NumberKind::Float }
    }
}

impl NpyArray {
    /// Reads an array of f2, f4, f8, or of integers of 1, 2, 4 or 8 bytes, in little-endian bytes and C order.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read, is cut short, or has other numbers.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let bytes = vsi::read(path).map_err(|e| ReadError::new(path, e))?;
        parse(&bytes).map_err(|cause| ReadError::new(path, cause))
    }

    /// Writes the values as f4.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let sizes: Vec<String> = self.shape.iter().map(|n| format!("{n},")).collect();
        let shape = sizes.join(" ");
        let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
        let before = MAGIC.len() + 4;
        let padded = (before + header.len() + 1).next_multiple_of(ALIGNMENT) - before;
        header.extend(std::iter::repeat_n(' ', padded - header.len() - 1));
        header.push('\n');
        let mut bytes = [MAGIC, &[1, 0], &(padded as u16).to_le_bytes()[..], header.as_bytes()].concat();
        bytes.extend(self.values.iter().flat_map(|v| v.to_le_bytes()));
        write_file(path, &bytes)
    }
}

fn parse(bytes: &[u8]) -> Result<NpyArray, String> {
    let rest = bytes.strip_prefix(MAGIC).ok_or("the file is no NumPy array")?;
    let (length, rest) = match *rest {
        [1, _, a, b, ref rest @ ..] => (usize::from(u16::from_le_bytes([a, b])), rest),
        [2 | 3, _, a, b, c, d, ref rest @ ..] => (u32::from_le_bytes([a, b, c, d]) as usize, rest),
        _ => return Err("the version of the format is unknown".into()),
    };
    let (header, data) = rest.split_at_checked(length).ok_or("the file ends in its header")?;
    let header = std::str::from_utf8(header).map_err(|_| "the header is no text")?;
    let shape = shape(header).ok_or_else(|| format!("the header has no shape: {}", header.trim_end()))?;
    let value_of = |name: &str| {
        let (_, after) = header.split_once(&format!("'{name}':"))?;
        after.split(',').next().map(str::trim)
    };
    if value_of("fortran_order") != Some("False") {
        return Err("the array is in Fortran order; numpy.ascontiguousarray changes that".into());
    }
    let kind = value_of("descr").unwrap_or_default().trim_matches('\'');
    let decode: (usize, fn(&[u8]) -> f32) = match kind {
        "<f2" => (2, |b| half(u16::from_le_bytes(array(b)))),
        "<f4" => (4, |b| f32::from_le_bytes(array(b))),
        "<f8" => (8, |b| f64::from_le_bytes(array(b)) as f32),
        "|b1" | "|u1" => (1, |b| b[0].into()),
        "|i1" => (1, |b| i8::from_le_bytes(array(b)).into()),
        "<u2" => (2, |b| u16::from_le_bytes(array(b)).into()),
        "<i2" => (2, |b| i16::from_le_bytes(array(b)).into()),
        "<u4" => (4, |b| u32::from_le_bytes(array(b)) as f32),
        "<i4" => (4, |b| i32::from_le_bytes(array(b)) as f32),
        "<u8" => (8, |b| u64::from_le_bytes(array(b)) as f32),
        "<i8" => (8, |b| i64::from_le_bytes(array(b)) as f32),
        _ => {
            return Err(format!(
                "the numbers are `{kind}`, expected floating-point numbers or integers in little-endian bytes"
            ));
        }
    };
    let count = shape.iter().try_fold(1usize, |n, size| n.checked_mul(*size)).filter(|n| *n <= MOST_VALUES);
    let count = count.ok_or_else(|| format!("the shape {shape:?} is too large"))?;
    if data.len() != count * decode.0 {
        let (expected, found) = (count * decode.0, data.len());
        return Err(format!("{found} bytes follow the header, the shape {shape:?} needs {expected}"));
    }
    let values = data.chunks_exact(decode.0).map(decode.1).collect();
    let kind = match kind {
        "<u2" => NumberKind::U16,
        _ if kind.contains('f') => NumberKind::Float,
        _ => NumberKind::Integer,
    };
    Ok(NpyArray { shape, values, kind })
}

fn shape(header: &str) -> Option<Vec<usize>> {
    let (_, after) = header.split_once("'shape':")?;
    let (inside, _) = after.trim_start().strip_prefix('(')?.split_once(')')?;
    let sizes = inside.split(',').map(str::trim).filter(|size| !size.is_empty());
    sizes.map(|size| size.parse().ok()).collect()
}

/// A number of half precision (IEEE 754 binary16) from its bits.
fn half(bits: u16) -> f32 {
    let sign = if bits >> 15 == 1 { -1.0 } else { 1.0 };
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023) / 1024.0);
    sign * match exponent {
        0 => fraction * 2f32.powi(-14),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1.0 + fraction) * 2f32.powi(exponent - 15),
    }
}

/// The bytes of a number; the caller gives as many as it has.
fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    std::array::from_fn(|k| bytes[k])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let length = (header.len() as u16).to_le_bytes();
        [MAGIC, &[1, 0], &length, header.as_bytes(), data].concat()
    }

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npy");
        let array = NpyArray {
            shape: vec![2, 3],
            values: vec![1.0, 2.5, f32::MAX, -1.0, 0.0, 7.0],
            kind: NumberKind::Float,
        };
        array.write(&path).unwrap();
        assert_eq!(NpyArray::read(&path).unwrap(), array);
        assert_eq!((std::fs::metadata(&path).unwrap().len() - 24) % 64, 0);
    }

    #[test]
    fn whole_numbers_are_read_as_they_are() {
        let of = |kind: &str, data: &[u8]| {
            parse(&file(&format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': (2,), }}\n"), data))
                .unwrap()
        };
        let shorts = of("<u2", &[1, 0, 255, 255]);
        assert!(shorts.kind == NumberKind::U16 && shorts.values == [1.0, 65535.0]);
        let doubles = of("<f8", &[1.5f64.to_le_bytes(), (-2f64).to_le_bytes()].concat());
        assert!(doubles.kind == NumberKind::Float && doubles.values == [1.5, -2.0]);
        let longs = of("<i8", &[70_000i64.to_le_bytes(), (-1i64).to_le_bytes()].concat());
        assert!(longs.kind == NumberKind::Integer && longs.values == [70_000.0, -1.0]);
        let halves = of("<f2", &[0x00, 0xc0, 0x01, 0x00]);
        assert!(halves.kind == NumberKind::Float && halves.values == [-2.0, 2f32.powi(-24)]);
    }

    #[test]
    fn damaged_files_are_refused() {
        let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 2), }\n";
        for (bytes, expected) in [
            (b"no array".to_vec(), "no NumPy array"),
            (file(good, &[0; 7]), "7 bytes follow"),
            (file(&good.replace("<f4", ">f4"), &[0; 8]), ">f4"),
            (file(&good.replace("False", "True"), &[0; 8]), "Fortran order"),
            (file(&good.replace("(1, 2)", "(-1, 2)"), &[0; 8]), "no shape"),
            (file(&good.replace("(1, 2)", "(99999999999, 99999999999)"), &[0; 8]), "too large"),
            (file(good, &[0; 8])[..20].to_vec(), "ends in its header"),
        ] {
            let error = parse(&bytes).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }
}
