//! Networks that a user brings as ONNX files and that take one picture, evaluated with rten.

mod error;
mod graph;
mod model;

pub use error::OnnxError;
pub(crate) use model::{MOST_SIDE_PX, Normalization, OnnxModel, OnnxOutput, OnnxTensor};

#[cfg(test)]
pub(crate) mod made_graph;
