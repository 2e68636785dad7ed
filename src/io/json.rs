//! Reading and writing of JSON files.

use super::{ReadError, WriteError, read_text, write_file};
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Numbers that Python's `json` module writes, which JSON does not have.
const NOT_FINITE: [&str; 3] = ["-Infinity", "Infinity", "NaN"];

/// Reads a JSON file.
///
/// # Errors
/// [`ReadError`] if the file cannot be read or does not hold a `T`.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, ReadError> {
    serde_json::from_str(&read_text(path)?).map_err(|e| ReadError::new(path, e))
}

/// Reads a JSON file in which numbers that are not finite may stand as Python's `json` module writes them: they are read as
/// `null`.
///
/// # Errors
/// As [`read_json`].
pub fn read_python_json<T: DeserializeOwned>(path: &Path) -> Result<T, ReadError> {
    let text = read_text(path)?;
    let parsed = serde_json::from_str(&text).or_else(|e| match without_infinities(&text) {
        Some(text) => serde_json::from_str(&text),
        None => Err(e),
    });
    parsed.map_err(|e| ReadError::new(path, e))
}

/// The text with `null` in place of numbers that are not finite; none if there are none outside of strings.
fn without_infinities(text: &str) -> Option<String> {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    let (mut is_in_string, mut is_escaped, mut found) = (false, false, false);
    while let Some(first) = rest.chars().next() {
        let number = NOT_FINITE.iter().find(|n| !is_in_string && rest.starts_with(**n));
        let length = number.map_or(first.len_utf8(), |n| n.len());
        let (head, tail) = rest.split_at(length);
        out.push_str(if number.is_some() { "null" } else { head });
        found |= number.is_some();
        is_in_string ^= first == '"' && !is_escaped;
        is_escaped = first == '\\' && !is_escaped;
        rest = tail;
    }
    found.then_some(out)
}

/// Writes a value as indented JSON, atomically.
///
/// # Errors
/// [`WriteError`] if the value cannot be serialised or the file cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), WriteError> {
    write_file(path, serde_json::to_string_pretty(value).map_err(|e| WriteError::new(path, e))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_are_not_finite_are_null_outside_of_strings() {
        let text = r#"{"a\"NaN": [NaN, -Infinity, 1], "b": "Infinity"}"#;
        let expected = r#"{"a\"NaN": [null, null, 1], "b": "Infinity"}"#;
        assert_eq!(without_infinities(text).as_deref(), Some(expected));
        assert_eq!(without_infinities("{\"NaN\": 1}"), None);
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_content() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        std::fs::write(&path, "\u{feff}{\"a\": 1}").unwrap();
        assert_eq!(read_json::<serde_json::Value>(&path).unwrap()["a"], 1);
    }
}
