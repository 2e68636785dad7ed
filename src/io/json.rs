//! Reading and writing of JSON files.

use super::{ReadError, WriteError, write_file};
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Reads a JSON file.
///
/// # Errors
/// [`ReadError`] if the file cannot be read or does not hold a `T`.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, ReadError> {
    let text = std::fs::read(path).map_err(|e| ReadError::new(path, e))?;
    serde_json::from_slice(&text).map_err(|e| ReadError::new(path, e))
}

/// Writes a value as indented JSON, atomically.
///
/// # Errors
/// [`WriteError`] if the value cannot be serialised or the file cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), WriteError> {
    write_file(path, serde_json::to_string_pretty(value).map_err(|e| WriteError::new(path, e))?)
}
