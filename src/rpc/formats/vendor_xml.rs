//! Recognition of the format of an XML file.

use super::keys::{Fields, RPC00B};
use super::xml::{find, parse};
use super::{FormatError, RpcFile, ViewTags, dimap, maxar};
use roxmltree::Node;
use std::path::Path;

/// Reads an XML file: Maxar XML with an `RPB` element, DIMAP, or GDAL's VRT and `.aux.xml`.
pub(super) fn from_xml(file: &Path, content: &str) -> Result<RpcFile, FormatError> {
    let document = parse(file, content)?;
    let root = document.root_element();
    if let Some(rpb) = find(root, "RPB") {
        return maxar::from_xml(file, root, rpb);
    }
    if let Some(model) = find(root, "Global_RFM") {
        return dimap::from_xml(file, root, model);
    }
    let gdal = |n: &Node| n.tag_name().name() == "Metadata" && n.attribute("domain") == Some("RPC");
    if let Some(domain) = root.descendants().find(gdal) {
        return from_gdal_xml(file, domain);
    }
    Err(FormatError::Unrecognised { file: file.into(), what: what_it_is(root) })
}

/// Metadata of an image in an XML file, with or without an RPC.
pub(super) fn tags_of_xml(file: &Path, content: &str) -> Result<ViewTags, FormatError> {
    let document = parse(file, content)?;
    let root = document.root_element();
    Ok(if find(root, "IMD").is_some() { maxar::tags(root) } else { dimap::tags(root) })
}

/// Reads the `RPC` metadata domain as GDAL stores it in XML files.
fn from_gdal_xml(file: &Path, domain: Node) -> Result<RpcFile, FormatError> {
    let mut fields = Fields::new(file, &RPC00B);
    for item in domain.children().filter(|n| n.tag_name().name() == "MDI") {
        let key = item.attribute("key").unwrap_or_default().to_ascii_uppercase();
        fields.take(&key, item.text().unwrap_or_default())?;
    }
    Ok(RpcFile::new(fields.rpc()?, "GDAL metadata"))
}

/// What a file without an RPC seems to be, for [`FormatError::Unrecognised`].
fn what_it_is(root: Node) -> &'static str {
    match root.tag_name().name() {
        "level_X" => " (it is EnMAP metadata, which has one RPC for each band)",
        "Dimap_Document" => " (it is a DIMAP product file; the RPC is in RPC_*.XML beside it)",
        _ => " (it is XML without an RPC)",
    }
}
