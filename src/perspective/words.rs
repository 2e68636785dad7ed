//! Numbers in text files, separated by blanks or commas.

use super::error::PerspectiveError;
use crate::io::{parse_number, read_text};
use std::path::Path;

/// The words of a text file.
pub(super) fn words_of(path: &Path) -> Result<Vec<String>, PerspectiveError> {
    let text = read_text(path)?;
    let words = text.split(|c: char| c.is_whitespace() || c == ',').filter(|w| !w.is_empty());
    Ok(words.map(str::to_owned).collect())
}

/// The first numbers among words. `field` names them in errors.
pub(super) fn numbers<const N: usize>(
    path: &Path,
    field: &str,
    words: &[String],
) -> Result<[f64; N], PerspectiveError> {
    let mut out = [0.0; N];
    for (i, value) in out.iter_mut().enumerate() {
        let expected = || format!("{N} numbers");
        let word = words.get(i).ok_or_else(|| {
            PerspectiveError::field(path, field, format!("{} values", words.len()), expected())
        })?;
        *value = parse_number(word)
            .ok_or_else(|| PerspectiveError::field(path, field, format!("`{word}`"), expected()))?;
    }
    Ok(out)
}

/// The rows of a 4 x 4 matrix.
pub(super) fn rows(matrix: &[f64; 16]) -> Vec<[f64; 4]> {
    let row = |r: &[f64]| std::array::from_fn(|i| r.get(i).copied().unwrap_or(f64::NAN));
    matrix.chunks(4).map(row).collect()
}
