//! Small ONNX files that tests write.

#![allow(dead_code, missing_docs, clippy::unwrap_used)]

use std::path::PathBuf;

/// A graph with the input `x`, as ONNX bytes; sides of -1 are open.
#[derive(Default)]
pub struct Graph {
    pub input: &'static [i64],
    pub nodes: Vec<Vec<u8>>,
    pub constants: Vec<Vec<u8>>,
    pub output: &'static str,
}

impl Graph {
    /// Writes the file into a new folder, which lives as long as the first value.
    pub fn write(&self) -> (tempfile::TempDir, PathBuf) {
        let dim = |d: &i64| block(1, &if *d < 0 { block(2, b"side") } else { number(1, *d) });
        let dims: Vec<u8> = self.input.iter().flat_map(dim).collect();
        let float = number(1, 1);
        let input =
            [block(1, b"x"), block(2, &block(1, &[float.clone(), block(2, &dims)].concat()))].concat();
        let output = [block(1, self.output.as_bytes()), block(2, &block(1, &float))].concat();
        let mut graph: Vec<u8> = self.nodes.iter().flat_map(|n| block(1, n)).collect();
        graph.extend(self.constants.iter().flat_map(|c| block(5, c)));
        graph.extend([block(11, &input), block(12, &output)].concat());
        let bytes = [number(1, 8), block(7, &graph), block(8, &number(2, 17))].concat();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("graph.onnx");
        std::fs::write(&path, bytes).unwrap();
        (folder, path)
    }
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

pub fn number(field: u64, value: i64) -> Vec<u8> {
    [varint(field << 3), varint(value as u64)].concat()
}

pub fn block(field: u64, content: &[u8]) -> Vec<u8> {
    [varint(field << 3 | 2), varint(content.len() as u64), content.to_vec()].concat()
}

pub fn node(op_type: &str, inputs: &[&str], outputs: &[&str], attributes: &[Vec<u8>]) -> Vec<u8> {
    let name = op_type.to_lowercase();
    let names =
        inputs.iter().map(|i| block(1, i.as_bytes())).chain(outputs.iter().map(|o| block(2, o.as_bytes())));
    let own = [block(3, name.as_bytes()), block(4, op_type.as_bytes())];
    names.chain(own).chain(attributes.iter().cloned()).flatten().collect()
}

pub fn ints(name: &str, values: &[i64]) -> Vec<u8> {
    let values: Vec<u8> = values.iter().flat_map(|v| number(8, *v)).collect();
    block(5, &[block(1, name.as_bytes()), values, number(20, 7)].concat())
}

pub fn int(name: &str, value: i64) -> Vec<u8> {
    block(5, &[block(1, name.as_bytes()), number(3, value), number(20, 2)].concat())
}

pub fn text(name: &str, value: &str) -> Vec<u8> {
    block(5, &[block(1, name.as_bytes()), block(4, value.as_bytes()), number(20, 3)].concat())
}

pub fn float_tensor(name: &str, dims: &[i64], values: &[f32]) -> Vec<u8> {
    tensor(name, dims, 1, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

pub fn int64_tensor(name: &str, values: &[i64]) -> Vec<u8> {
    tensor(name, &[values.len() as i64], 7, values.iter().flat_map(|v| v.to_le_bytes()).collect())
}

pub fn tensor(name: &str, dims: &[i64], data_type: i64, raw: Vec<u8>) -> Vec<u8> {
    let dims: Vec<u8> = dims.iter().flat_map(|d| number(1, *d)).collect();
    [dims, number(2, data_type), block(8, name.as_bytes()), block(9, &raw)].concat()
}
