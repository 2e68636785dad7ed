//! What must be known of an ONNX file before a runtime reads it: that it is whole, and that it has no cubic `Resize`.
//!
//! ONNX files are messages of the schema `onnx.proto` (<https://github.com/onnx/onnx/blob/main/onnx/onnx.proto>). rten allocates
//! what a field says is its length, and computes cubic interpolation as linear.

use super::fault::Fault;
use super::wire::Slice;

/// Depth up to which graphs may contain graphs, counted in messages.
const MOST_NESTED: usize = 64;

/// Checks a file.
pub fn check(bytes: &[u8]) -> Result<(), Fault> {
    let model = Slice::file(bytes);
    let mut graphs = 0;
    for field in model.fields() {
        graphs += usize::from(field?.number == MODEL_GRAPH);
    }
    if graphs == 0 {
        return Err(Fault::Damaged { at: bytes.len(), reason: "it has no graph" });
    }
    walk(Message::Model, model, 0)
}

/// Numbers of fields.
pub const MODEL_GRAPH: u64 = 7;
pub const NODE_INPUT: u64 = 1;
pub const NODE_OUTPUT: u64 = 2;
pub const NODE_NAME: u64 = 3;
pub const NODE_OP_TYPE: u64 = 4;
pub const NODE_ATTRIBUTE: u64 = 5;
pub const ATTRIBUTE_NAME: u64 = 1;
pub const ATTRIBUTE_STRING: u64 = 4;

/// Messages of the schema that contain messages which a runtime reads.
#[derive(Clone, Copy, PartialEq)]
enum Message {
    Model,
    Graph,
    Node,
    Attribute,
    Tensor,
    ValueInfo,
    Type,
    TensorType,
    SequenceType,
    Shape,
    /// One with simple fields only.
    Leaf,
}

impl Message {
    /// The message in a field; none if it is text, bytes or numbers.
    fn child(self, field: u64) -> Option<Self> {
        match (self, field) {
            (Self::Model, MODEL_GRAPH) | (Self::Attribute, 6 | 11) => Some(Self::Graph),
            (Self::Graph, 1) => Some(Self::Node),
            (Self::Node, NODE_ATTRIBUTE) => Some(Self::Attribute),
            (Self::Graph, 5) | (Self::Attribute, 5 | 10) => Some(Self::Tensor),
            (Self::Graph, 11..=13) => Some(Self::ValueInfo),
            (Self::ValueInfo, 2) | (Self::SequenceType, 1) => Some(Self::Type),
            (Self::Type, 1) => Some(Self::TensorType),
            (Self::Type, 4) => Some(Self::SequenceType),
            (Self::TensorType, 2) => Some(Self::Shape),
            (Self::Model, 8 | 14) | (Self::Tensor, 13) | (Self::Shape, 1) => Some(Self::Leaf),
            _ => None,
        }
    }
}

/// Checks a message and those within it.
fn walk(message: Message, content: Slice, depth: usize) -> Result<(), Fault> {
    if depth > MOST_NESTED {
        return Err(Fault::Damaged { at: content.start, reason: "messages are nested too deeply" });
    }
    for field in content.fields() {
        let field = field?;
        if let Some(child) = message.child(field.number) {
            let Some(content) = field.content() else {
                return Err(Fault::Damaged {
                    at: field.start,
                    reason: "a number stands where a message is expected",
                });
            };
            walk(child, content, depth + 1)?;
        }
    }
    if message == Message::Node && is_cubic_resize(content)? {
        return Err(Fault::CubicResize { node: name_of(content)? });
    }
    Ok(())
}

/// The name of a node; its first output where it has none.
pub fn name_of(node: Slice) -> Result<String, Fault> {
    let name = node.text(NODE_NAME)?.filter(|name| !name.is_empty());
    Ok(name.or(node.text(NODE_OUTPUT)?).unwrap_or_default().to_owned())
}

fn is_cubic_resize(node: Slice) -> Result<bool, Fault> {
    if node.text(NODE_OP_TYPE)? != Some("Resize") {
        return Ok(false);
    }
    for attribute in node.all(NODE_ATTRIBUTE)? {
        let is_mode = attribute.text(ATTRIBUTE_NAME)? == Some("mode");
        if is_mode && attribute.text(ATTRIBUTE_STRING)? == Some("cubic") {
            return Ok(true);
        }
    }
    Ok(false)
}
