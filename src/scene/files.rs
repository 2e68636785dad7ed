//! Names and content of files.

use super::SceneError;
use crate::io::{decode_text, vsi};
use std::path::Path;

/// Text of a list of views or of an area of interest, in any encoding that [`decode_text`] knows.
pub(super) fn read_text(path: &Path) -> Result<String, SceneError> {
    let bytes = vsi::read(path).map_err(|cause| SceneError::Unreadable { path: path.into(), cause })?;
    Ok(decode_text(&bytes))
}

/// The file name without its extension.
pub(super) fn stem(path: &Path) -> String {
    path.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// The file name, for messages.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}
