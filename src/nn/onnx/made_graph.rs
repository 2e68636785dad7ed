//! Small ONNX files that tests write.

#![allow(dead_code, missing_docs, clippy::unwrap_used)]

use super::writer::{block, number};
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

/// An attribute with text.
pub fn text(name: &str, value: &str) -> Vec<u8> {
    block(5, &[block(1, name.as_bytes()), block(4, value.as_bytes()), number(20, 3)].concat())
}
