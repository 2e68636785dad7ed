//! `_RPC.TXT`: one `KEY: value unit` a line, as IKONOS, GeoEye, Planet and GDAL write it.

use super::keys::{Fields, RPC00B, format_number};
use super::{FormatError, RpcFile};
use crate::rpc::Rpc;
use std::fmt::Write;
use std::path::Path;

/// Reads the text of such a file; `file` is for messages.
///
/// Accepts units, signs, `D` exponents, any case of keys, `=` or a blank for `:`, no blank behind it, CRLF, a byte-order
/// mark; fields it does not know are skipped, `ERR_BIAS` and `ERR_RAND` are optional.
///
/// # Errors
/// [`FormatError`].
pub(super) fn from_text(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let mut fields = Fields::new(file, &RPC00B);
    for line in content.lines() {
        // `KEY: value`, `KEY = value`, or a blank alone between them.
        let parted = line.split_once([':', '=']).or_else(|| line.trim().split_once([' ', '\t']));
        let Some((key, value)) = parted else { continue };
        if value.trim().eq_ignore_ascii_case("RPC00A") {
            return Err(FormatError::Rpc00a { file: file.into() });
        }
        fields.take(&key.trim().to_ascii_uppercase(), value)?;
    }
    if fields.is_empty() {
        return Err(FormatError::Unrecognised { file: file.into(), what: "" });
    }
    Ok(RpcFile::new(fields.rpc()?, "RPC text"))
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
