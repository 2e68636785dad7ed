//! RPC files: GDAL's metadata domain, `_RPC.TXT` text and rpcm JSON, read and written.
//!
//! Every one of them counts pixels from the centre of the first, as satgs does. What a sidecar is shows in its
//! content, not in its name. Writing and reading back gives the same bits.

mod gdal;
mod json;
mod keys;
mod text;

pub use gdal::{from_gdal, to_gdal};
pub use json::{from_json, iso_date, to_json};
pub use text::{from_text, to_text};

use super::{Rpc, RpcError};
use std::path::{Path, PathBuf};

/// A sidecar larger than this is no RPC.
const MAX_BYTES: u64 = 64 << 20;

/// Why a file gives no RPC.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum FormatError {
    /// A number that every RPC has is not there.
    #[error("`{file}`: RPC field `{field}` is missing (found {found} of {of} fields)", of = keys::REQUIRED)]
    #[diagnostic(help(
        "the RPC is incomplete: ask for the original metadata; `satgs info` lists what was read"
    ))]
    Missing {
        /// The file.
        file: PathBuf,
        /// The first field that is missing, in the file's own names.
        field: String,
        /// Numbers found.
        found: usize,
    },
    /// A polynomial with more or fewer than twenty terms.
    #[error("`{file}`: RPC field `{field}` has {found} coefficients, 20 are expected")]
    #[diagnostic(help("RPC00B has 20 coefficients in each of its four polynomials"))]
    Count {
        /// The file.
        file: PathBuf,
        /// The polynomial.
        field: String,
        /// Coefficients found.
        found: usize,
    },
    /// Text where a number should be.
    #[error("`{file}`: `{field}` is `{text}`, a number is expected")]
    #[diagnostic(help(
        "numbers have a decimal point, no comma, and at most a unit behind: `-0.0703 degrees`"
    ))]
    NotANumber {
        /// The file.
        file: PathBuf,
        /// The field.
        field: String,
        /// What was found.
        text: String,
    },
    /// Numbers that make no camera.
    #[error("`{file}`: {source}")]
    #[diagnostic(help("{hint}"))]
    Invalid {
        /// The file.
        file: PathBuf,
        /// Which number, and why.
        source: RpcError,
        /// What to do about it.
        hint: &'static str,
    },
    /// Broken JSON.
    #[error("`{file}` is no valid JSON: {reason}")]
    #[diagnostic(help("NaN and Infinity are no JSON numbers; is the file complete?"))]
    Json {
        /// The file.
        file: PathBuf,
        /// Where and why.
        reason: String,
    },
    /// None of the formats.
    #[error("`{file}` is no RPC file that satgs reads{what}")]
    #[diagnostic(help(
        "read are `_RPC.TXT` text, rpcm JSON, and whatever GDAL shows in its RPC metadata domain"
    ))]
    Unrecognised {
        /// The file.
        file: PathBuf,
        /// What it looks like, if that is known.
        what: &'static str,
    },
    /// The file cannot be read at all.
    #[error("`{file}` cannot be read: {reason}")]
    #[diagnostic(help("does the file exist, and may you read it?"))]
    Unreadable {
        /// The file.
        file: PathBuf,
        /// The system's words.
        reason: String,
    },
}

impl FormatError {
    fn invalid(file: &Path, source: RpcError) -> Self {
        let hint = match &source {
            RpcError::OutOfRange { .. } => "are latitude and longitude swapped?",
            RpcError::Pole { .. } => "are the coefficients in the order of RPC00B?",
            _ => "the RPC is damaged: ask for the original metadata",
        };
        Self::Invalid { file: file.into(), source, hint }
    }
}

/// A view's metadata that some RPC files hold beside the camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewTags {
    /// File name of the image.
    pub image: Option<String>,
    /// Columns and rows of the image.
    pub size: Option<(usize, usize)>,
    /// Sun's azimuth clockwise from north and elevation, degrees.
    pub sun_deg: Option<(f64, f64)>,
    /// Acquisition time, ISO 8601.
    pub acquired: Option<String>,
    /// Lowest and highest ellipsoidal height on the ground, metres.
    pub height_range: Option<(f64, f64)>,
}

/// What an RPC file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RpcFile {
    /// The camera.
    pub rpc: Rpc,
    /// What else the file says.
    pub tags: ViewTags,
}

/// Reads a sidecar in any format, recognised by its content.
///
/// # Errors
/// [`FormatError`], naming file and field.
pub fn read(file: &Path) -> Result<RpcFile, FormatError> {
    parse(file, &read_text(file)?)
}

/// As [`read`], of content in memory; `file` is for messages.
///
/// # Errors
/// As [`read`].
pub fn parse(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let content = content.trim_start_matches('\u{feff}').trim_start();
    let unrecognised = |what| FormatError::Unrecognised { file: file.into(), what };
    match content.as_bytes().first() {
        Some(b'{') => from_json(file, content),
        Some(b'<') => Err(unrecognised(" (it is XML)")),
        None => Err(unrecognised(" (it is empty)")),
        _ => Ok(RpcFile { rpc: from_text(file, content)?, tags: ViewTags::default() }),
    }
}

/// Text of a regular file of reasonable size; bytes that are no UTF-8 do not matter, they are comments.
fn read_text(file: &Path) -> Result<String, FormatError> {
    let unreadable = |reason: String| FormatError::Unreadable { file: file.into(), reason };
    let about = std::fs::metadata(file).map_err(|e| unreadable(e.to_string()))?;
    if !about.is_file() {
        return Err(unreadable("not a regular file".into()));
    }
    if about.len() > MAX_BYTES {
        return Err(unreadable(format!("{} bytes are too many for an RPC", about.len())));
    }
    let bytes = std::fs::read(file).map_err(|e| unreadable(e.to_string()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests;
