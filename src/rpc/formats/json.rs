//! JSON files of the rpcm library and of sat-NeRF: an object `rpc` with rpcm's field names; beside it sun, date and size.

use super::keys::{Fields, RPCM};
use super::{FormatError, RpcFile, ViewTags, iso_date};
use crate::rpc::Rpc;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Reads an rpcm JSON, or the `rpc` object alone; `file` names it in messages.
///
/// # Errors
/// [`FormatError`] for invalid JSON, and if the file does not hold a valid RPC.
pub(super) fn from_json(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let top: Map<String, Value> =
        serde_json::from_str(content).map_err(|cause| FormatError::Json { file: file.into(), cause })?;
    let rpc = match top.get("rpc") {
        Some(Value::Object(rpc)) => rpc,
        None if top.contains_key(RPCM.polynomials[0]) => &top,
        _ => return Err(FormatError::Missing { file: file.into(), field: "rpc".into(), found: 0 }),
    };
    let mut fields = Fields::new(file, &RPCM);
    for (name, value) in rpc {
        fields.take(name, &words(value))?;
    }
    let tags = tags(file, &top)?;
    Ok(RpcFile { tags, ..RpcFile::new(fields.rpc()?, "rpcm JSON") })
}

/// The camera and metadata of a view as the text of an rpcm JSON file.
#[must_use]
pub fn to_json(camera: &Rpc, tags: &ViewTags) -> String {
    let c = camera.coefficients();
    let mut rpc = Map::new();
    for (name, value) in RPCM.axes(c).into_iter().chain(RPCM.known_errors(c)) {
        rpc.insert(name.into(), json!(value));
    }
    for (name, terms) in RPCM.terms(c) {
        rpc.insert(name.into(), json!(terms.as_slice()));
    }
    let mut top = Map::new();
    if let Some(image) = &tags.image {
        top.insert("img".into(), json!(image));
    }
    if let Some((width, height)) = tags.size {
        top.insert("width".into(), json!(width));
        top.insert("height".into(), json!(height));
    }
    if let Some((azimuth, elevation)) = tags.sun_deg {
        // Angles are strings, the elevation with its sign, as sat-NeRF writes and reads them.
        top.insert("sun_azimuth".into(), json!(format!("{azimuth}")));
        top.insert("sun_elevation".into(), json!(format!("{elevation:+}")));
    }
    if let Some(acquired) = &tags.acquired {
        let digits: String = acquired.chars().filter(char::is_ascii_digit).take(14).collect();
        top.insert("acquisition_date".into(), json!(digits));
    }
    if let Some((low, high)) = tags.height_range {
        top.insert("min_alt".into(), json!(low));
        top.insert("max_alt".into(), json!(high));
    }
    top.insert("rpc".into(), Value::Object(rpc));
    let mut text = serde_json::to_string_pretty(&Value::Object(top)).unwrap_or_default();
    text.push('\n');
    text
}

fn tags(file: &Path, top: &Map<String, Value>) -> Result<ViewTags, FormatError> {
    let number = |name: &str| match top.get(name) {
        None | Some(Value::Null) => Ok(None),
        Some(value) => {
            let text = words(value);
            let finite = super::keys::parse_number(&text).filter(|v| v.is_finite());
            finite.map(Some).ok_or_else(|| FormatError::NotANumber {
                file: file.into(),
                field: name.into(),
                text: text.chars().take(40).collect(),
            })
        }
    };
    let both = |a: &str, b: &str| Ok::<_, FormatError>(number(a)?.zip(number(b)?));
    Ok(ViewTags {
        image: top.get("img").and_then(Value::as_str).map(str::to_owned),
        size: both("width", "height")?.map(|(w, h)| (w as usize, h as usize)),
        sun_deg: both("sun_azimuth", "sun_elevation")?,
        acquired: top.get("acquisition_date").map(words).and_then(|d| iso_date(&d)),
        height_range: both("min_alt", "max_alt")?,
        ..ViewTags::default()
    })
}

/// A JSON value as text from which numbers are parsed; elements of arrays are separated by blanks.
fn words(value: &Value) -> String {
    match value {
        Value::String(s) => s.clone(),
        Value::Array(items) => items.iter().map(words).collect::<Vec<_>>().join(" "),
        other => other.to_string(),
    }
}
