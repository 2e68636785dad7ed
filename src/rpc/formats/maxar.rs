//! Files of Maxar (DigitalGlobe): `.XML` with the elements `RPB` and `IMD`, and the same content as PVL text in `.RPB`
//! and `.IMD`.

use super::keys::{Fields, Names, format_number, parse_number};
use super::xml::{find, items, text};
use super::{FormatError, RpcFile, ViewTags, iso_date};
use crate::rpc::Rpc;
use roxmltree::Node;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// Field names of `.RPB` files.
const RPB: Names = Names {
    offsets: ["lineOffset", "sampOffset", "latOffset", "longOffset", "heightOffset"],
    scales: ["lineScale", "sampScale", "latScale", "longScale", "heightScale"],
    polynomials: ["lineNumCoef", "lineDenCoef", "sampNumCoef", "sampDenCoef"],
    errors: ["errBias", "errRand"],
};

/// Field names of XML files.
const XML: Names = Names {
    offsets: ["LINEOFFSET", "SAMPOFFSET", "LATOFFSET", "LONGOFFSET", "HEIGHTOFFSET"],
    scales: ["LINESCALE", "SAMPSCALE", "LATSCALE", "LONGSCALE", "HEIGHTSCALE"],
    polynomials: ["LINENUMCOEF", "LINEDENCOEF", "SAMPNUMCOEF", "SAMPDENCOEF"],
    errors: ["ERRBIAS", "ERRRAND"],
};

/// Reads the RPC from the `RPB` element, and sun, date and size from the `IMD` element.
pub(super) fn from_xml(file: &Path, root: Node, rpb: Node) -> Result<RpcFile, FormatError> {
    refuse_rpc00a(file, text(rpb, "SPECID"))?;
    let mut fields = Fields::new(file, &XML);
    for (name, value) in find(rpb, "IMAGE").into_iter().flat_map(items) {
        fields.take(name, value)?;
    }
    for name in XML.polynomials {
        if let Some(terms) = text(rpb, name) {
            fields.take(name, terms)?;
        }
    }
    Ok(RpcFile { tags: tags(root), ..RpcFile::new(fields.rpc()?, "Maxar XML") })
}

/// Metadata of the image in the `IMD` element.
pub(super) fn tags(root: Node) -> ViewTags {
    let Some(imd) = find(root, "IMD") else { return ViewTags::default() };
    view_tags(|name| text(imd, &name.to_ascii_uppercase()).map(str::to_owned))
}

/// Whether a text is an `.RPB` or `.IMD` file, whose statements end with a semicolon.
pub(super) fn is_pvl(content: &str) -> bool {
    let known = ["lineOffset", "lineNumCoef", "BEGIN_GROUP", "specId"];
    known.iter().any(|word| content.contains(word)) && content.contains(';')
}

/// Reads an `.RPB` file.
///
/// # Errors
/// [`FormatError`].
pub(super) fn from_rpb(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let items = pvl(content);
    refuse_rpc00a(file, items.get("specId").map(String::as_str))?;
    let mut fields = Fields::new(file, &RPB);
    for (key, value) in &items {
        fields.take(key, value)?;
    }
    if fields.is_empty() {
        let what = " (it is Maxar metadata without an RPC; that is in the .RPB beside it)";
        return Err(FormatError::Unrecognised { file: file.into(), what });
    }
    Ok(RpcFile { tags: imd_tags(content), ..RpcFile::new(fields.rpc()?, "RPB") })
}

/// Metadata of the image in an `.IMD` file.
pub(super) fn imd_tags(content: &str) -> ViewTags {
    let items = pvl(content);
    view_tags(|name| items.get(name).cloned())
}

/// Column and row of the first pixel of a tile in its product, from the product's `.TIL` file; `None` if the file does not
/// list the tile. `image` is the file name of the tile.
///
/// # Errors
/// [`FormatError::Unreadable`] if the `.TIL` file cannot be read.
pub fn til_offset(til: &Path, image: &str) -> Result<Option<(f64, f64)>, FormatError> {
    let content = super::read_text(til)?;
    // Each tile is a group: `BEGIN_GROUP = TILE_1 … END_GROUP = TILE_1`.
    for group in content.split("BEGIN_GROUP") {
        let items = pvl(group.split_once('\n').unwrap_or_default().1);
        if items.get("filename").is_some_and(|name| name.eq_ignore_ascii_case(image)) {
            let number = |name: &str| parse_number(items.get(name)?).filter(|v| v.is_finite());
            return Ok(number("ULColOffset").zip(number("ULRowOffset")));
        }
    }
    Ok(None)
}

/// A camera as the text of an `.RPB` file.
#[must_use]
pub fn to_rpb(rpc: &Rpc) -> String {
    let c = rpc.coefficients();
    // Readers of the format require both errors; -1 means unknown.
    let errors = RPB.errors.into_iter().zip([c.err_bias_m, c.err_rand_m].map(|e| e.unwrap_or(-1.0)));
    let mut out = String::from("satId = \"\";\nbandId = \"\";\nSpecId = \"RPC00B\";\nBEGIN_GROUP = IMAGE\n");
    for (name, value) in errors.chain(RPB.axes(c)) {
        let _ = writeln!(out, "\t{name} = {};", format_number(value));
    }
    for (name, terms) in RPB.terms(c) {
        let terms: Vec<String> = terms.iter().map(|t| format!("\t\t\t{}", format_number(*t))).collect();
        let _ = writeln!(out, "\t{name} = (\n{});", terms.join(",\n"));
    }
    out.push_str("END_GROUP = IMAGE\nEND;\n");
    out
}

/// The statements `key = value;` of a PVL text; elements of lists are separated by blanks, quotes are removed.
fn pvl(content: &str) -> BTreeMap<String, String> {
    let mut items = BTreeMap::new();
    for statement in content.split(';') {
        // Lines such as `BEGIN_GROUP = IMAGE` have no semicolon and would become part of the next statement.
        let groups = statement.lines().filter(|l| !l.contains("_GROUP")).collect::<Vec<_>>().join(" ");
        let Some((key, value)) = groups.split_once('=') else { continue };
        let key = if key.trim() == "SpecId" { "specId" } else { key.trim() };
        let value = value.replace(['(', ')', ',', '"'], " ");
        items.insert(key.to_owned(), value.trim().to_owned());
    }
    items
}

/// Metadata by the field names of `.IMD` files; `item` returns the text of a field. Names in XML are in capitals.
fn view_tags(item: impl Fn(&str) -> Option<String>) -> ViewTags {
    let number = |name: &str| parse_number(&item(name)?).filter(|v| v.is_finite());
    let count = |name: &str| number(name).filter(|v| *v >= 1.0).map(|v| v as usize);
    // Mosaicked and orthorectified products state the time of the strip instead of that of the first line.
    let time = ["firstLineTime", "TLCTime", "earliestAcqTime"].iter().find_map(|n| iso_date(&item(n)?));
    ViewTags {
        size: count("numColumns").zip(count("numRows")),
        sun_deg: number("meanSunAz").zip(number("meanSunEl")),
        acquired: time,
        gsd_m: number("meanProductGSD").or_else(|| number("meanCollectedGSD")),
        // `meanOffNadirViewAngle` is not used because it is the angle at the satellite.
        off_nadir_deg: number("meanSatEl").map(|elevation| 90.0 - elevation),
        ..ViewTags::default()
    }
}

fn refuse_rpc00a(file: &Path, spec: Option<&str>) -> Result<(), FormatError> {
    match spec {
        Some(spec) if spec.eq_ignore_ascii_case("RPC00A") => Err(FormatError::Rpc00a { file: file.into() }),
        _ => Ok(()),
    }
}
