//! Field names of an RPC in the known formats.
//!
//! The reader of a format collects numbers by name in [`Fields`]; [`Fields::rpc`] checks that all 90 are there.

use super::FormatError;
use crate::rpc::model::TERMS;
use crate::rpc::{Axis, Rpc, RpcCoefficients, RpcError};
use std::array::from_fn;
use std::collections::BTreeMap;
use std::path::Path;

/// Number of required fields: five offsets, five scales, and four polynomials of 20 coefficients.
pub(super) const REQUIRED: usize = 90;

/// Field names of a format, in the order line, sample, latitude, longitude, height.
pub(super) struct Names {
    /// The offsets.
    pub offsets: [&'static str; 5],
    /// The scales.
    pub scales: [&'static str; 5],
    /// Line numerator, line denominator, sample numerator, sample denominator.
    pub polynomials: [&'static str; 4],
    /// Bias and random error.
    pub errors: [&'static str; 2],
}

/// The names of RPC00B, as GDAL's metadata domain and `_RPC.TXT` files use them.
pub(super) const RPC00B: Names = Names {
    offsets: ["LINE_OFF", "SAMP_OFF", "LAT_OFF", "LONG_OFF", "HEIGHT_OFF"],
    scales: ["LINE_SCALE", "SAMP_SCALE", "LAT_SCALE", "LONG_SCALE", "HEIGHT_SCALE"],
    polynomials: ["LINE_NUM_COEFF", "LINE_DEN_COEFF", "SAMP_NUM_COEFF", "SAMP_DEN_COEFF"],
    errors: ["ERR_BIAS", "ERR_RAND"],
};

/// The names of the rpcm library's JSON.
pub(super) const RPCM: Names = Names {
    offsets: ["row_offset", "col_offset", "lat_offset", "lon_offset", "alt_offset"],
    scales: ["row_scale", "col_scale", "lat_scale", "lon_scale", "alt_scale"],
    polynomials: ["row_num", "row_den", "col_num", "col_den"],
    errors: ["err_bias", "err_rand"],
};

impl Names {
    /// Names and values of offsets and scales.
    pub(super) fn axes(&self, c: &RpcCoefficients) -> [(&'static str, f64); 10] {
        let axes = [c.row, c.col, c.lat, c.lon, c.height];
        std::array::from_fn(|i| match i {
            0..5 => (self.offsets[i], axes[i].offset),
            _ => (self.scales[i - 5], axes[i - 5].scale),
        })
    }

    /// Names and coefficients of the polynomials.
    pub(super) fn terms<'a>(&self, c: &'a RpcCoefficients) -> [(&'static str, &'a [f64; TERMS]); 4] {
        let polynomials = [&c.row_num, &c.row_den, &c.col_num, &c.col_den];
        std::array::from_fn(|i| (self.polynomials[i], polynomials[i]))
    }

    /// Names and values of the errors that are known.
    pub(super) fn known_errors(&self, c: &RpcCoefficients) -> Vec<(&'static str, f64)> {
        let both = self.errors.into_iter().zip([c.err_bias_m, c.err_rand_m]);
        both.filter_map(|(name, value)| Some((name, value?))).collect()
    }
}

/// Numbers of an RPC that were found in a file so far.
pub(super) struct Fields<'a> {
    file: &'a Path,
    names: &'static Names,
    values: BTreeMap<String, f64>,
}

impl<'a> Fields<'a> {
    /// No numbers yet.
    pub(super) const fn new(file: &'a Path, names: &'static Names) -> Self {
        Self { file, names, values: BTreeMap::new() }
    }

    /// Whether no field of an RPC was found.
    pub(super) fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Adds a field if `name` is one of an RPC; the twenty coefficients of a polynomial may come in one text.
    pub(super) fn take(&mut self, name: &str, text: &str) -> Result<(), FormatError> {
        let n = self.names;
        if n.errors.contains(&name) {
            // The errors are optional; a blank and `N/A` mean unknown.
            if let Some(value) = parse_number(text) {
                self.put(name.into(), value)?;
            }
        } else if n.offsets.contains(&name) || n.scales.contains(&name) {
            let value = self.number(name, text)?;
            self.put(name.into(), value)?;
        } else if n.polynomials.contains(&name) {
            // Coefficients are separated by blanks or commas; a comma may follow the last one.
            let terms: Vec<&str> =
                text.split(|c: char| c == ',' || c.is_whitespace()).filter(|t| !t.is_empty()).collect();
            self.check_count(name, terms.len())?;
            for (i, term) in terms.iter().enumerate() {
                let field = format!("{name}_{}", i + 1);
                let value = self.number(&field, term)?;
                self.put(field, value)?;
            }
        } else if let Some((polynomial, index)) = n.split_term(name) {
            self.check_count(polynomial, index.max(TERMS))?;
            let field = format!("{polynomial}_{index}");
            let value = self.number(&field, text)?;
            self.put(field, value)?;
        }
        Ok(())
    }

    /// Checks that all fields are there and form a valid RPC.
    pub(super) fn rpc(self) -> Result<Rpc, FormatError> {
        self.require_all()?;
        let n = self.names;
        let value = |name: &str| self.values.get(name).copied().unwrap_or(f64::NAN);
        let axis = |i: usize| Axis { offset: value(n.offsets[i]), scale: value(n.scales[i]) };
        let terms = |i: usize| from_fn(|k| value(&format!("{}_{}", n.polynomials[i], k + 1)));
        let error = |i: usize| self.values.get(n.errors[i]).copied().unwrap_or(-1.0);
        in_file_order(from_fn(axis), from_fn(terms), from_fn(error))
            .map_err(|e| FormatError::invalid(self.file, e))
    }

    /// Adds the value of a field; a second, different value is an error.
    fn put(&mut self, field: String, value: f64) -> Result<(), FormatError> {
        match self.values.get(&field).copied() {
            Some(first) if first.to_bits() != value.to_bits() && first != value => {
                Err(FormatError::Twice { file: self.file.into(), field, first, second: value })
            }
            _ => {
                self.values.insert(field, value);
                Ok(())
            }
        }
    }

    fn require_all(&self) -> Result<(), FormatError> {
        let n = self.names;
        let has = |name: &str| self.values.contains_key(name);
        let mut required: Vec<String> = n.offsets.iter().chain(&n.scales).map(|s| (*s).into()).collect();
        for p in n.polynomials {
            required.extend((1..=TERMS).map(|i| format!("{p}_{i}")));
        }
        let found = required.iter().filter(|f| has(f)).count();
        let Some(first) = required.into_iter().find(|f| !has(f)) else { return Ok(()) };
        // A polynomial without any coefficient is named itself, instead of its first coefficient.
        let whole = |p: &&str| (1..=TERMS).all(|i| !has(&format!("{p}_{i}")));
        let field = match n.split_term(&first) {
            Some((p, _)) if whole(&p) => p.to_owned(),
            _ => first,
        };
        Err(FormatError::Missing { file: self.file.into(), field, found })
    }

    fn check_count(&self, field: &str, found: usize) -> Result<(), FormatError> {
        if found == TERMS {
            return Ok(());
        }
        Err(FormatError::Count { file: self.file.into(), field: field.into(), found, expected: TERMS })
    }

    fn number(&self, field: &str, text: &str) -> Result<f64, FormatError> {
        parse_number(text).ok_or_else(|| FormatError::NotANumber {
            file: self.file.into(),
            field: field.into(),
            text: text.trim().chars().take(40).collect(),
        })
    }
}

impl Names {
    /// `LINE_NUM_COEFF_7` is term 7 of `LINE_NUM_COEFF`.
    fn split_term(&self, name: &str) -> Option<(&'static str, usize)> {
        let polynomial = self.polynomials.into_iter().find(|p| name.starts_with(p))?;
        let index = name[polynomial.len()..].strip_prefix('_')?.parse().ok()?;
        (index > 0).then_some((polynomial, index))
    }
}

/// Parses a number as vendors write it: with a sign, an exponent marked by `D`, and a unit after it.
pub(super) fn parse_number(text: &str) -> Option<f64> {
    let mut words = text.split_whitespace();
    let number = words.next()?;
    if words.any(|unit| unit.chars().any(|c| c.is_ascii_digit())) {
        return None;
    }
    let number = number.trim_end_matches(';');
    number.parse().ok().or_else(|| number.replace(['D', 'd'], "E").parse().ok())
}

/// The shortest text that is parsed as the same number.
pub(super) fn format_number(v: f64) -> String {
    let size = v.abs();
    if size == 0.0 || (1e-4..1e16).contains(&size) { format!("{v}") } else { format!("{v:e}") }
}

/// A model from numbers in the order of files: axes of row, column, latitude, longitude and height; numerator and
/// denominator of the row, then of the column; bias and random error, negative if unknown.
pub(super) fn in_file_order(
    [row, col, lat, lon, height]: [Axis; 5],
    [row_num, row_den, col_num, col_den]: [[f64; TERMS]; 4],
    errors: [f64; 2],
) -> Result<Rpc, RpcError> {
    let [err_bias_m, err_rand_m] = errors.map(|e| (e >= 0.0).then_some(e));
    Rpc::new(RpcCoefficients {
        col,
        row,
        lon,
        lat,
        height,
        col_num,
        col_den,
        row_num,
        row_den,
        err_bias_m,
        err_rand_m,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_with_signs_units_and_fortran_exponents_are_parsed() {
        assert_eq!(parse_number(" +005124.00 pixels\r"), Some(5124.0));
        assert_eq!(parse_number("1.0D-03"), Some(1e-3));
        assert_eq!(parse_number("-000.0070300e+01 degrees"), Some(-0.0703));
        assert_eq!(parse_number("1,5"), None);
        assert_eq!(parse_number("1 000 pixels"), None);
        assert_eq!(parse_number(""), None);
    }
}
