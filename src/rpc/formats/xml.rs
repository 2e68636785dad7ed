//! Parsing of XML files and search for elements.

use super::FormatError;
use roxmltree::{Document, Node, ParsingOptions};
use std::path::Path;

/// Largest number of elements of an XML file; ten times that of the largest known file, of EnMAP.
const MAX_ELEMENTS: u32 = 1_000_000;

/// Parses an XML file.
///
/// # Errors
/// [`FormatError::Xml`] if the file is not valid XML or has more than [`MAX_ELEMENTS`] elements.
pub(super) fn parse<'a>(file: &Path, content: &'a str) -> Result<Document<'a>, FormatError> {
    let options = ParsingOptions { nodes_limit: MAX_ELEMENTS, ..ParsingOptions::default() };
    Document::parse_with_options(content, options)
        .map_err(|cause| FormatError::Xml { file: file.into(), cause })
}

/// The first element of this name at any depth.
pub(super) fn find<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.descendants().find(|n| n.tag_name().name() == name)
}

/// The text of the first element of this name at any depth.
pub(super) fn text<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    find(node, name)?.text().map(str::trim)
}

/// The number in the first element of this name at any depth.
pub(super) fn number(node: Node, name: &str) -> Option<f64> {
    super::keys::parse_number(text(node, name)?).filter(|v| v.is_finite())
}

/// Names and texts of the children of an element.
pub(super) fn items<'a>(node: Node<'a, '_>) -> impl Iterator<Item = (&'a str, &'a str)> {
    node.children().filter(Node::is_element).map(|n| (n.tag_name().name(), n.text().unwrap_or_default()))
}
