//! GDAL's `RPC` metadata domain: what GDAL makes of a GeoTIFF's tag 50844, a NITF's RPC00B and many sidecars.

use super::FormatError;
use super::keys::{Fields, RPC00B, format_number};
use crate::rpc::Rpc;
use std::path::Path;

/// The camera of a metadata domain; none when the domain is empty. `file` is for messages.
///
/// # Errors
/// [`FormatError`].
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

/// The metadata domain of a camera, to the last bit; GDAL's own text of a tag has 15 digits.
#[must_use]
pub fn to_gdal(rpc: &Rpc) -> Vec<(String, String)> {
    let c = rpc.coefficients();
    let mut out: Vec<(String, String)> =
        RPC00B.axes(c).into_iter().map(|(name, value)| (name.into(), format_number(value))).collect();
    for (name, terms) in RPC00B.terms(c) {
        let terms: Vec<String> = terms.iter().map(|t| format_number(*t)).collect();
        out.push((name.into(), terms.join(" ")));
    }
    // GDAL wants both errors; -1 says that they are not known.
    for (name, value) in RPC00B.errors.into_iter().zip([c.err_bias_m, c.err_rand_m]) {
        out.push((name.into(), format_number(value.unwrap_or(-1.0))));
    }
    out
}
