//! Networks with several inputs, known by their names, and one output.

use super::error::OnnxError;
use super::runtime::Runtime;
use crate::io::Cause;
use rten::{NodeId, Value};
use std::path::{Path, PathBuf};

/// A tensor of an input, by its shape.
pub(crate) enum NamedInput {
    Float(Vec<usize>, Vec<f32>),
    Whole(Vec<usize>, Vec<i32>),
}

/// A network from an ONNX file.
pub(crate) struct NamedModel {
    path: PathBuf,
    runtime: Runtime,
    inputs: Vec<NodeId>,
    output: NodeId,
}

impl NamedModel {
    /// Reads a network with inputs of these names.
    ///
    /// # Errors
    /// [`OnnxError`] if the file cannot be read or is cut short, if the graph has other inputs or no output, or if it has operators
    /// that rten does not compute.
    pub fn load(path: &Path, names: &[&str]) -> Result<Self, OnnxError> {
        let runtime = Runtime::load(path)?;
        let model = runtime.model();
        let inputs: Vec<NodeId> = names.iter().filter_map(|name| model.find_node(name)).collect();
        if inputs.len() != names.len() || inputs.len() != model.input_ids().len() {
            let found =
                model.input_ids().iter().filter_map(|id| model.node_info(*id)?.name().map(str::to_owned));
            let found = found.collect::<Vec<_>>().join(", ");
            return Err(OnnxError::Names { path: path.into(), found, expected: names.join(", ") });
        }
        let output = *model.output_ids().first().ok_or_else(|| OnnxError::NoOutput { path: path.into() })?;
        Ok(Self { path: path.into(), runtime, inputs, output })
    }

    /// A text of the file's metadata.
    pub fn metadata(&self, key: &str) -> Option<&str> {
        self.runtime.model().metadata().get(key)
    }

    /// The output, a matrix of these rows and columns, for inputs in the order of their names.
    ///
    /// # Errors
    /// [`OnnxError::Run`] if the network cannot be evaluated, or its output has another shape or values that are not finite.
    pub fn evaluate(&self, inputs: Vec<NamedInput>, size: [usize; 2]) -> Result<Vec<f32>, OnnxError> {
        let failed = |cause: Cause| OnnxError::Run { path: self.path.clone(), cause };
        let value = |input: NamedInput| match input {
            NamedInput::Float(shape, values) => Value::from_shape(&shape[..], values).map_err(Cause::from),
            NamedInput::Whole(shape, values) => Value::from_shape(&shape[..], values).map_err(Cause::from),
        };
        let values = inputs.into_iter().map(|input| value(input).map_err(failed));
        let values = values.collect::<Result<Vec<_>, _>>()?;
        let values = self.inputs.iter().copied().zip(values.into_iter().map(Into::into)).collect();
        let output = self.runtime.run(values, self.output).map_err(failed)?;
        let (shape, values) = output.into_shape_vec::<f32, 2>().map_err(|e| failed(e.into()))?;
        if shape != size {
            return Err(failed(format!("its output is {shape:?}, expected {size:?}").into()));
        }
        if values.iter().any(|v| !v.is_finite()) {
            return Err(failed("its output has values that are not finite".into()));
        }
        Ok(values)
    }
}
