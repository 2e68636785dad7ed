//! GDAL's `RPC` metadata domain, which GDAL fills from the TIFF tag 50844, the RPC00B segment of NITF and many sidecar
//! files.

use super::FormatError;
use super::keys::{Fields, RPC00B, format_number};
use crate::rpc::Rpc;
use std::path::Path;

/// The camera of the `RPC` metadata domain, given as (key, value) pairs; `None` if the domain is empty. `file` names the
/// image in messages.
///
/// # Errors
/// [`FormatError`] if a coefficient is missing or not a number, or the coefficients are not a valid RPC.
pub fn from_gdal(file: &Path, domain: &[(String, String)]) -> Result<Option<Rpc>, FormatError> {
    if domain.is_empty() {
        return Ok(None);
    }
    let mut fields = Fields::new(file, &RPC00B);
    for (key, value) in domain {
        fields.take(&key.to_ascii_uppercase(), value)?;
    }
    fields.rpc().map(Some)
}

/// The (key, value) pairs of the `RPC` metadata domain for a camera, with all digits of each number; GDAL itself writes
/// 15 digits.
#[must_use]
pub fn to_gdal(rpc: &Rpc) -> Vec<(String, String)> {
    let c = rpc.coefficients();
    let mut out: Vec<(String, String)> =
        RPC00B.axes(c).into_iter().map(|(name, value)| (name.into(), format_number(value))).collect();
    for (name, terms) in RPC00B.terms(c) {
        let terms: Vec<String> = terms.iter().map(|t| format_number(*t)).collect();
        out.push((name.into(), terms.join(" ")));
    }
    // GDAL requires both errors; -1 means unknown.
    for (name, value) in RPC00B.errors.into_iter().zip([c.err_bias_m, c.err_rand_m]) {
        out.push((name.into(), format_number(value.unwrap_or(-1.0))));
    }
    out
}
