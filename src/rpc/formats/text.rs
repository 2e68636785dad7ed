//! `_RPC.TXT`: one `KEY: value unit` a line, as IKONOS, GeoEye, Planet and GDAL write it.

use super::FormatError;
use super::keys::{Fields, RPC00B, format_number};
use crate::rpc::Rpc;
use std::fmt::Write;
use std::path::Path;

/// Reads the text of such a file; `file` is for messages.
///
/// Accepts units, signs, `D` exponents, any case of keys, `=` for `:`, no blank behind it, CRLF, a byte-order
/// mark; fields it does not know are skipped, `ERR_BIAS` and `ERR_RAND` are optional.
///
/// # Errors
/// [`FormatError`].
pub fn from_text(file: &Path, content: &str) -> Result<Rpc, FormatError> {
    let mut fields = Fields::new(file, &RPC00B);
    for line in content.trim_start_matches('\u{feff}').lines() {
        let Some((key, value)) = line.split_once([':', '=']) else { continue };
        fields.take(&key.trim().to_ascii_uppercase(), value)?;
    }
    if fields.is_empty() {
        let is_rpb = content.to_ascii_lowercase().contains("lineoffset");
        let what = if is_rpb { " (it looks like an RPB)" } else { "" };
        return Err(FormatError::Unrecognised { file: file.into(), what });
    }
    fields.rpc()
}

/// The text of an `_RPC.TXT` with units, as GDAL reads it too.
#[must_use]
pub fn to_text(rpc: &Rpc) -> String {
    let c = rpc.coefficients();
    let mut out = String::new();
    for (name, value) in RPC00B.axes(c) {
        let unit = match name.split('_').next() {
            Some("LINE" | "SAMP") => "pixels",
            Some("HEIGHT") => "meters",
            _ => "degrees",
        };
        let _ = writeln!(out, "{name}: {} {unit}", format_number(value));
    }
    for (name, terms) in RPC00B.terms(c) {
        for (i, term) in terms.iter().enumerate() {
            let _ = writeln!(out, "{name}_{}: {}", i + 1, format_number(*term));
        }
    }
    for (name, value) in RPC00B.known_errors(c) {
        let _ = writeln!(out, "{name}: {} meters", format_number(value));
    }
    out
}
