//! Little-endian values from the bytes of a file.

use super::super::error::PerspectiveError;
use crate::io::{ReadError, vsi};
use std::path::{Path, PathBuf};

/// The rest of a file.
pub(super) struct Bytes {
    path: PathBuf,
    content: Vec<u8>,
    at: usize,
}

impl Bytes {
    /// All bytes of a file.
    pub(super) fn of(path: &Path) -> Result<Self, PerspectiveError> {
        let content = vsi::read(path).map_err(|e| ReadError::new(path, e))?;
        Ok(Self { path: path.into(), content, at: 0 })
    }

    /// The file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    fn left(&self) -> &[u8] {
        self.content.get(self.at..).unwrap_or_default()
    }

    fn cut_short(&self, field: &str, needed: u64) -> PerspectiveError {
        let (path, left) = (self.path.clone(), self.left().len() as u64);
        PerspectiveError::CutShort { path, field: field.into(), needed, left }
    }

    /// The next bytes as an array.
    fn take<const N: usize>(&mut self, field: &str) -> Result<[u8; N], PerspectiveError> {
        let next = self.left().first_chunk::<N>().copied();
        let next = next.ok_or_else(|| self.cut_short(field, N as u64))?;
        self.at += N;
        Ok(next)
    }

    pub(super) fn u8s<const N: usize>(&mut self, field: &str) -> Result<[u8; N], PerspectiveError> {
        self.take(field)
    }

    pub(super) fn u32(&mut self, field: &str) -> Result<u32, PerspectiveError> {
        self.take(field).map(u32::from_le_bytes)
    }

    pub(super) fn i32(&mut self, field: &str) -> Result<i32, PerspectiveError> {
        self.take(field).map(i32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, field: &str) -> Result<u64, PerspectiveError> {
        self.take(field).map(u64::from_le_bytes)
    }

    pub(super) fn f64(&mut self, field: &str) -> Result<f64, PerspectiveError> {
        self.take(field).map(f64::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self, field: &str) -> Result<[f64; N], PerspectiveError> {
        let mut out = [0.0; N];
        for value in &mut out {
            *value = self.f64(field)?;
        }
        Ok(out)
    }

    /// A count of records of at least `smallest` bytes each, all of which the rest of the file can hold.
    pub(super) fn count(&mut self, field: &str, smallest: u64) -> Result<usize, PerspectiveError> {
        let count = self.u64(field)?;
        let needed = count.saturating_mul(smallest);
        if needed > self.left().len() as u64 {
            return Err(self.cut_short(&format!("{field} ({count})"), needed));
        }
        Ok(count as usize)
    }

    /// A text that ends with a zero byte.
    pub(super) fn text(&mut self, field: &str) -> Result<String, PerspectiveError> {
        let length = self.left().iter().position(|b| *b == 0).ok_or_else(|| self.cut_short(field, 1))?;
        let bytes = self.left().get(..length).unwrap_or_default().to_vec();
        self.at += length + 1;
        String::from_utf8(bytes).map_err(|e| {
            let found = String::from_utf8_lossy(e.as_bytes()).into_owned();
            PerspectiveError::field(&self.path, field, format!("`{found}`"), "text in UTF-8")
        })
    }

    /// Checks that nothing is left.
    pub(super) fn end(&self) -> Result<(), PerspectiveError> {
        match self.left().len() {
            0 => Ok(()),
            n => Err(PerspectiveError::field(
                &self.path,
                "the end",
                format!("followed by {n} bytes"),
                "the end",
            )),
        }
    }
}
