//! What must be known of an ONNX file before a runtime reads it: that it is whole, and that its operators are computed as written.
//!
//! ONNX files are Protocol Buffers messages (<https://protobuf.dev/programming-guides/encoding/>) of the schema `onnx.proto`
//! (<https://github.com/onnx/onnx/blob/main/onnx/onnx.proto>). rten allocates what a field says is its length, and computes cubic
//! interpolation as linear; here every length is compared with the bytes that there are, and cubic `Resize` nodes are found.

/// Depth up to which graphs may contain graphs, counted in messages.
const MOST_NESTED: usize = 64;

/// Why a file is refused.
#[derive(Debug, PartialEq)]
pub enum Fault {
    /// The bytes are no whole ONNX model.
    Damaged { at: usize, reason: &'static str },
    /// A `Resize` with cubic polynomials, by its name or its first output.
    CubicResize { node: String },
}

/// Checks a file.
pub fn check(bytes: &[u8]) -> Result<(), Fault> {
    let model = Slice { bytes, start: 0 };
    let mut graphs = 0;
    for field in model.fields() {
        graphs += usize::from(field?.number == MODEL_GRAPH);
    }
    if graphs == 0 {
        return Err(Fault::Damaged { at: bytes.len(), reason: "it has no graph" });
    }
    walk(Message::Model, model, 0)
}

const MODEL_GRAPH: u64 = 7;
const NODE_OUTPUT: u64 = 2;
const NODE_NAME: u64 = 3;
const NODE_OP_TYPE: u64 = 4;
const NODE_ATTRIBUTE: u64 = 5;
const ATTRIBUTE_NAME: u64 = 1;
const ATTRIBUTE_STRING: u64 = 4;

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
            let Some(content) = field.content else {
                return Err(Fault::Damaged {
                    at: field.start,
                    reason: "a number stands where a message is expected",
                });
            };
            walk(child, content, depth + 1)?;
        }
    }
    if message == Message::Node && is_cubic_resize(content)? {
        let name = first_text(content, NODE_NAME)?.filter(|name| !name.is_empty());
        let node = name.or(first_text(content, NODE_OUTPUT)?).unwrap_or_default();
        return Err(Fault::CubicResize { node: String::from_utf8_lossy(node).into_owned() });
    }
    Ok(())
}

fn is_cubic_resize(node: Slice) -> Result<bool, Fault> {
    if first_text(node, NODE_OP_TYPE)? != Some(b"Resize") {
        return Ok(false);
    }
    for field in node.fields() {
        let field = field?;
        if let (NODE_ATTRIBUTE, Some(attribute)) = (field.number, field.content) {
            let is_mode = first_text(attribute, ATTRIBUTE_NAME)? == Some(b"mode");
            if is_mode && first_text(attribute, ATTRIBUTE_STRING)? == Some(b"cubic") {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// The first field of a number, if it is text.
fn first_text(message: Slice<'_>, number: u64) -> Result<Option<&[u8]>, Fault> {
    for field in message.fields() {
        let field = field?;
        if field.number == number {
            return Ok(field.content.map(|content| content.bytes));
        }
    }
    Ok(None)
}

/// A part of the file, and where it starts.
#[derive(Clone, Copy)]
struct Slice<'a> {
    bytes: &'a [u8],
    start: usize,
}

impl<'a> Slice<'a> {
    /// The fields of the message that the bytes are.
    fn fields(self) -> Fields<'a> {
        Fields { rest: self }
    }

    /// Takes the first `length` bytes off.
    fn take(&mut self, length: u64) -> Result<Self, Fault> {
        let split = usize::try_from(length).ok().and_then(|length| self.bytes.split_at_checked(length));
        let (first, rest) =
            split.ok_or(Fault::Damaged { at: self.start, reason: "a field is longer than the rest" })?;
        let taken = Self { bytes: first, start: self.start };
        *self = Self { bytes: rest, start: self.start + first.len() };
        Ok(taken)
    }

    /// Takes an integer of variable length off: seven bits a byte, the lowest first.
    fn take_varint(&mut self) -> Result<u64, Fault> {
        let mut value = 0;
        for (k, byte) in self.bytes.iter().take(10).enumerate() {
            value |= u64::from(byte & 0x7F) << (7 * k);
            if byte & 0x80 == 0 {
                self.take(k as u64 + 1)?;
                return Ok(value);
            }
        }
        Err(Fault::Damaged { at: self.start, reason: "an integer does not end" })
    }
}

/// A field of a message.
struct Field<'a> {
    number: u64,
    start: usize,
    /// Bytes of a field that has a length; none of a number.
    content: Option<Slice<'a>>,
}

/// The fields of a message; ends after the first damaged one.
struct Fields<'a> {
    rest: Slice<'a>,
}

impl<'a> Fields<'a> {
    fn field(&mut self) -> Result<Field<'a>, Fault> {
        let start = self.rest.start;
        let tag = self.rest.take_varint()?;
        let content = match tag & 7 {
            0 => self.rest.take_varint().map(|_| None)?,
            1 => self.rest.take(8).map(|_| None)?,
            2 => {
                let length = self.rest.take_varint()?;
                Some(self.rest.take(length)?)
            }
            5 => self.rest.take(4).map(|_| None)?,
            _ => return Err(Fault::Damaged { at: start, reason: "a field has no known type" }),
        };
        Ok(Field { number: tag >> 3, start, content })
    }
}

impl<'a> Iterator for Fields<'a> {
    type Item = Result<Field<'a>, Fault>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.rest.bytes.is_empty() {
            return None;
        }
        let field = self.field();
        if field.is_err() {
            self.rest.bytes = &[];
        }
        Some(field)
    }
}
