//! Names and content of files.

use super::SceneError;
use crate::io::{decode_text, vsi};
use std::path::Path;

/// Text of a list of views or of an area of interest, in any encoding that [`decode_text`] knows.
pub(super) fn read_text(path: &Path) -> Result<String, SceneError> {
    let bytes = vsi::read(path).map_err(|cause| SceneError::Unreadable { path: path.into(), cause })?;
    Ok(decode_text(&bytes))
}

/// The file name without its extension. The query of a URL is no part of a name.
pub(super) fn stem(path: &Path) -> String {
    vsi::split_query(path).0.file_stem().map_or_else(String::new, |s| s.to_string_lossy().into_owned())
}

/// The file name. The query of a URL is no part of it.
pub(super) fn file_name(path: &Path) -> String {
    vsi::split_query(path).0.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned())
}

/// Whether a file name has one of some extensions, which are in lower case.
pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    let extension = vsi::split_query(path).0.extension();
    extension.is_some_and(|e| extensions.contains(&e.to_string_lossy().to_ascii_lowercase().as_str()))
}
