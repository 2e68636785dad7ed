//! Writing of ONNX files: Protocol Buffers messages (<https://protobuf.dev/programming-guides/encoding/>) of the schema `onnx.proto`
//! (<https://github.com/onnx/onnx/blob/main/onnx/onnx.proto>).

/// Version of the format, and of the set of operators.
const IR_VERSION: i64 = 8;
const OPERATORS: i64 = 17;
/// Codes of element types.
pub const FLOAT: i64 = 1;
const INT64: i64 = 7;

/// The type of the elements of an input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// Single precision.
    Float,
    /// 64-bit integers.
    Int64,
}

/// A side of a tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// It is known.
    Fixed(usize),
    /// It differs from call to call; sides of the same name are equal.
    Open(&'static str),
}

/// An input or output: its name, element type and shape.
pub type Port<'a> = (&'static str, Element, &'a [Side]);

/// A graph that is being written. Values have names `v0`, `v1`, … in the order in which they are made.
#[derive(Default)]
pub struct GraphWriter {
    nodes: Vec<u8>,
    constants: Vec<u8>,
    values: usize,
    /// What names begin with.
    prefix: String,
}

impl GraphWriter {
    /// Nodes for a graph that has others: the names of their values begin with this text.
    pub fn within(prefix: String) -> Self {
        Self { prefix, ..Self::default() }
    }

    fn name(&mut self) -> String {
        self.values += 1;
        format!("{}v{}", self.prefix, self.values - 1)
    }

    /// A tensor of constants.
    pub fn floats(&mut self, shape: &[usize], values: &[f32]) -> String {
        let name = self.name();
        let shape: Vec<i64> = shape.iter().map(|n| *n as i64).collect();
        self.constants.extend(block(5, &float_tensor(&name, &shape, values)));
        name
    }

    /// A vector of whole constants.
    pub fn integers(&mut self, values: &[i64]) -> String {
        let name = self.name();
        self.constants.extend(block(5, &int64_tensor(&name, values)));
        name
    }

    /// An operator with these inputs.
    pub fn node(&mut self, op_type: &str, inputs: &[&str], attributes: &[Vec<u8>]) -> String {
        let name = self.name();
        self.nodes.extend(block(1, &node(op_type, inputs, &[&name], attributes)));
        name
    }

    /// An operator whose outputs have names already.
    pub fn named_node(&mut self, op_type: &str, inputs: &[&str], outputs: &[&str], attributes: &[Vec<u8>]) {
        self.nodes.extend(block(1, &node(op_type, inputs, outputs, attributes)));
    }

    /// The fields of a graph message that hold the nodes and constants.
    pub fn into_fields(self) -> Vec<u8> {
        [self.nodes, self.constants].concat()
    }

    /// The bytes of the file. `output` is the value that becomes the output.
    #[must_use]
    pub fn finish(
        mut self,
        name: &str,
        inputs: &[Port],
        value: &str,
        output: Port,
        metadata: &[(&str, &str)],
    ) -> Vec<u8> {
        self.nodes.extend(block(1, &node("Identity", &[value], &[output.0], &[])));
        let mut graph = [self.nodes, block(2, name.as_bytes()), self.constants].concat();
        inputs.iter().for_each(|input| graph.extend(block(11, &port(input))));
        graph.extend(block(12, &port(&output)));
        let mut out =
            [number(1, IR_VERSION), block(2, b"satgs"), block(7, &graph), block(8, &number(2, OPERATORS))]
                .concat();
        for (key, value) in metadata {
            out.extend(block(14, &[block(1, key.as_bytes()), block(2, value.as_bytes())].concat()));
        }
        out
    }
}

fn port((name, element, shape): &Port) -> Vec<u8> {
    let side = |side: &Side| match side {
        Side::Fixed(n) => block(1, &number(1, *n as i64)),
        Side::Open(name) => block(1, &block(2, name.as_bytes())),
    };
    let sides: Vec<u8> = shape.iter().flat_map(side).collect();
    let element = number(1, if *element == Element::Float { FLOAT } else { INT64 });
    [block(1, name.as_bytes()), block(2, &block(1, &[element, block(2, &sides)].concat()))].concat()
}

pub fn varint(mut value: u64) -> Vec<u8> {
    let mut out = Vec::new();
    while value > 0x7F {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
    out
}

/// A field with a number.
pub fn number(field: u64, value: i64) -> Vec<u8> {
    [varint(field << 3), varint(value as u64)].concat()
}

/// A field with text or a message.
pub fn block(field: u64, content: &[u8]) -> Vec<u8> {
    [varint(field << 3 | 2), varint(content.len() as u64), content.to_vec()].concat()
}

/// A node of a graph.
pub fn node(op_type: &str, inputs: &[&str], outputs: &[&str], attributes: &[Vec<u8>]) -> Vec<u8> {
    let name = op_type.to_lowercase();
    let names =
        inputs.iter().map(|i| block(1, i.as_bytes())).chain(outputs.iter().map(|o| block(2, o.as_bytes())));
    let own = [block(3, name.as_bytes()), block(4, op_type.as_bytes())];
    names.chain(own).chain(attributes.iter().cloned()).flatten().collect()
}

/// An attribute with whole numbers.
pub fn ints(name: &str, values: &[i64]) -> Vec<u8> {
    let values: Vec<u8> = values.iter().flat_map(|v| number(8, *v)).collect();
    block(5, &[block(1, name.as_bytes()), values, number(20, 7)].concat())
}

/// An attribute with a whole number.
pub fn int(name: &str, value: i64) -> Vec<u8> {
    block(5, &[block(1, name.as_bytes()), number(3, value), number(20, 2)].concat())
}

/// A tensor of float32.
pub fn float_tensor(name: &str, dims: &[i64], values: &[f32]) -> Vec<u8> {
    tensor(name, dims, FLOAT, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

/// A vector of 64-bit integers.
pub fn int64_tensor(name: &str, values: &[i64]) -> Vec<u8> {
    tensor(name, &[values.len() as i64], INT64, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

/// A tensor of the element type with this code.
pub fn tensor(name: &str, dims: &[i64], data_type: i64, raw: Vec<u8>) -> Vec<u8> {
    let dims: Vec<u8> = dims.iter().flat_map(|d| number(1, *d)).collect();
    [dims, number(2, data_type), block(8, name.as_bytes()), block(9, &raw)].concat()
}
