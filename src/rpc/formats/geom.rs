//! OSSIM `.geom` keyword lists of an RPC projection, as OTB writes them. Pixels count from 0.

use super::keys::{Fields, Names, parse_number};
use super::{FormatError, RpcFile, ViewTags, iso_date};
use std::collections::BTreeMap;
use std::path::Path;

/// Field names of OSSIM. Names of coefficients end in `_00` to `_19`.
const GEOM: Names = Names {
    offsets: ["line_off", "samp_off", "lat_off", "long_off", "height_off"],
    scales: ["line_scale", "samp_scale", "lat_scale", "long_scale", "height_scale"],
    polynomials: ["line_num_coeff", "line_den_coeff", "samp_num_coeff", "samp_den_coeff"],
    errors: ["bias_error", "rand_error"],
};

/// Whether a text is an OSSIM keyword list with an RPC.
pub(super) fn is_geom(content: &str) -> bool {
    content.contains("line_num_coeff_00") || content.contains("polynomial_format")
}

/// Reads an OSSIM keyword list.
pub(super) fn from_geom(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let lines = content.lines().filter_map(|l| l.split_once(':'));
    let items: BTreeMap<&str, &str> = lines.map(|(k, v)| (k.trim(), v.trim())).collect();
    if items.get("polynomial_format").is_some_and(|f| f.eq_ignore_ascii_case("A")) {
        return Err(FormatError::Rpc00a { file: file.into() });
    }
    let mut fields = Fields::new(file, &GEOM);
    for (name, value) in &items {
        match name.rsplit_once('_').and_then(|(head, index)| Some((head, index.parse::<usize>().ok()?))) {
            Some((head, index)) => fields.take(&format!("{head}_{}", index.saturating_add(1)), value)?,
            None => fields.take(name, value)?,
        }
    }
    Ok(RpcFile { tags: tags(&items), ..RpcFile::new(fields.rpc()?, "OSSIM geom") })
}

fn tags(items: &BTreeMap<&str, &str>) -> ViewTags {
    let number = |name: &str| parse_number(items.get(name)?).filter(|v| v.is_finite());
    let count = |name: &str| number(name).filter(|v| *v >= 1.0).map(|v| v as usize);
    // The angles are listed for several positions along the image; the middle one is taken.
    let middle = |name: &str| {
        let words: Vec<&str> = items.get(name)?.trim_matches('"').split_whitespace().collect();
        parse_number(words.get(words.len() / 2)?).filter(|v| v.is_finite())
    };
    let (azimuth, elevation) = ("support_data.azimuth_angle", "support_data.elevation_angle");
    ViewTags {
        size: count("number_samples").zip(count("number_lines")),
        sun_deg: middle(azimuth).zip(middle(elevation)),
        off_nadir_deg: middle("support_data.incident_angle"),
        acquired: items.get("support_data.image_date").and_then(|d| iso_date(d)),
        ..ViewTags::default()
    }
}
