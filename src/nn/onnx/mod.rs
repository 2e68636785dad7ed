//! Networks that a user brings as ONNX files, evaluated with rten: those that take one picture, and those with named inputs. ONNX
//! files that are written.

mod convert;
mod error;
mod fault;
mod graph;
mod memory;
mod model;
mod named;
mod node;
mod operators;
mod resize;
mod runtime;
mod wire;
pub(crate) mod writer;

pub use error::OnnxError;
pub(crate) use model::{MOST_SIDE_PX, Normalization, OnnxModel, OnnxOutput, OnnxTensor};
pub(crate) use named::{NamedInput, NamedModel};

#[cfg(test)]
pub(crate) mod made_graph;
#[cfg(test)]
mod operator_tests;
