//! `_RPC.TXT` files of IKONOS, GeoEye, Planet and GDAL: one `KEY: value unit` per line.

use super::keys::{Fields, RPC00B, format_number};
use super::{FormatError, RpcFile};
use crate::rpc::Rpc;
use std::fmt::Write;
use std::path::Path;

/// Parses the text of an `_RPC.TXT` file; `file` names it in messages.
///
/// Units, signs, exponents marked by `D`, keys in any case, `=` or a blank instead of `:`, a missing blank after it, CRLF
/// and a byte-order mark are accepted. Unknown fields are skipped; `ERR_BIAS` and `ERR_RAND` are optional.
///
/// # Errors
/// [`FormatError`] if a coefficient is missing or not a number, or the coefficients are not a valid RPC.
pub(super) fn from_text(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let mut fields = Fields::new(file, &RPC00B);
    for line in content.lines() {
        // Key and value are separated by a colon, an equals sign or a blank.
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

/// A camera as the text of an `_RPC.TXT` file with units, which GDAL reads too.
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
