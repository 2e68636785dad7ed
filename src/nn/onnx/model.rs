//! A network with one picture as its input.

use super::error::OnnxError;
use super::memory::Estimate;
use super::runtime::Runtime;
use crate::io::Cause;
use rten::{DataType, Dimension, Model, NodeId, NodeInfo, TryFromValueError, Value, ValueType};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Largest side of an input, pixels: beyond it a file is damaged rather than made for such pictures.
pub const MOST_SIDE_PX: usize = 4096;

/// How a network expects the values of pictures: `(value - mean) / deviation`, of red, green and blue.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalization {
    mean: [f32; 3],
    deviation: [f32; 3],
}

impl Normalization {
    /// By the means and standard deviations over ImageNet.
    pub const IMAGENET: Self = Self { mean: [0.485, 0.456, 0.406], deviation: [0.229, 0.224, 0.225] };
    /// From -1 to 1.
    pub const SYMMETRIC: Self = Self { mean: [0.5; 3], deviation: [0.5; 3] };
    #[cfg(test)]
    pub const NONE: Self = Self { mean: [0.0; 3], deviation: [1.0; 3] };

    /// The value of a colour, counted from 0, which is clamped to [0, 1] before; NaN counts as 0.
    #[inline(always)]
    pub fn of(&self, color: usize, value: f32) -> f32 {
        let displayed = if value > 0.0 { value.min(1.0) } else { 0.0 };
        (displayed - self.mean[color]) / self.deviation[color]
    }
}

/// A network that takes one picture, f32 `[1, 3, rows, columns]`, and of which the first output is used.
pub struct OnnxModel {
    path: PathBuf,
    runtime: Runtime,
    input: NodeId,
    output: NodeId,
    rows: Option<usize>,
    columns: Option<usize>,
    /// Sizes of pictures, rows and columns, for which the memory is known to suffice.
    sufficient: Mutex<Vec<[usize; 2]>>,
}

/// A tensor of f32 of rank 3 or 4.
pub struct OnnxTensor {
    /// Number of values along each axis; the last axis changes fastest.
    pub shape: Vec<usize>,
    pub values: Vec<f32>,
}

impl OnnxTensor {
    /// Its type and shape.
    pub fn description(&self) -> String {
        format!("tensor(f32) {:?}", self.shape)
    }
}

/// The first output of a network.
pub enum OnnxOutput {
    Tensor(OnnxTensor),
    /// Something else, described.
    Other(String),
}

impl OnnxOutput {
    fn of(output: Value) -> Self {
        if let Ok((shape, values)) = output.clone().into_shape_vec::<f32, 3>() {
            return Self::Tensor(OnnxTensor { shape: shape.into(), values });
        }
        let found = output.dtype().to_string();
        match output.into_shape_vec::<f32, 4>() {
            Ok((shape, values)) => Self::Tensor(OnnxTensor { shape: shape.into(), values }),
            Err(TryFromValueError::WrongRank { actual, .. }) => {
                Self::Other(format!("{found} of rank {actual}"))
            }
            Err(_) => Self::Other(found),
        }
    }
}

impl OnnxModel {
    /// Reads a network.
    ///
    /// # Errors
    /// [`OnnxError`] if the file cannot be read or is cut short, if its graph takes something else than one picture or has no
    /// output, or if it has operators that rten does not compute or computes as others (cubic `Resize`).
    pub fn load(path: &Path) -> Result<Self, OnnxError> {
        let runtime = Runtime::load(path)?;
        let model = runtime.model();
        let Some((input, [rows, columns])) = picture_input(model) else {
            return Err(wrong_input(model, path, "[1, 3, rows, columns]"));
        };
        let output = *model.output_ids().first().ok_or_else(|| OnnxError::NoOutput { path: path.into() })?;
        Ok(Self { path: path.into(), runtime, input, output, rows, columns, sufficient: Mutex::default() })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Rows and columns of the picture, each if it is fixed.
    pub fn input_size(&self) -> [Option<usize>; 2] {
        [self.rows, self.columns]
    }

    /// The error that the input has another shape than `expected`.
    pub fn wrong_input(&self, expected: &'static str) -> OnnxError {
        wrong_input(self.runtime.model(), &self.path, expected)
    }

    /// The first output for a picture of these rows and columns: normalised values, colour by colour and row by row.
    ///
    /// # Errors
    /// [`OnnxError::Memory`], [`OnnxError::Run`].
    pub fn evaluate(&self, [rows, columns]: [usize; 2], values: Vec<f32>) -> Result<OnnxOutput, OnnxError> {
        self.check_memory([rows, columns])?;
        let failed = |cause: Cause| OnnxError::Run { path: self.path.clone(), cause };
        let picture = Value::from_shape([1, 3, rows, columns], values).map_err(|e| failed(e.into()))?;
        let output = self.runtime.run(vec![(self.input, picture.into())], self.output).map_err(failed)?;
        Ok(OnnxOutput::of(output))
    }

    /// Checks that the tensors for a picture fit into the memory that there is.
    fn check_memory(&self, [rows, columns]: [usize; 2]) -> Result<(), OnnxError> {
        let mut sufficient = self.sufficient.lock().unwrap_or_else(PoisonError::into_inner);
        if !sufficient.contains(&[rows, columns]) {
            let info = self.runtime.model().node_info(self.input);
            let name = info.as_ref().and_then(NodeInfo::name).unwrap_or_default();
            let estimate = Estimate::of(&self.path, name, &[1, 3, rows, columns])?;
            estimate.check(&self.path, [rows, columns])?;
            sufficient.push([rows, columns]);
        }
        Ok(())
    }
}

/// The graph's only input, and the rows and columns of its pictures, each if it is fixed.
fn picture_input(model: &Model) -> Option<(NodeId, [Option<usize>; 2])> {
    let &[id] = model.input_ids() else { return None };
    let info = model.node_info(id)?;
    let is_float = info.dtype().is_none_or(|dtype| dtype == ValueType::Tensor(DataType::Float));
    let size = info.shape().map_or(Some([None; 2]), |shape| picture_size(&shape));
    size.filter(|_| is_float).map(|size| (id, size))
}

/// Rows and columns of pictures of a shape, each if it is fixed; none if that is not `[1, 3, rows, columns]`.
fn picture_size(shape: &[Dimension]) -> Option<[Option<usize>; 2]> {
    let [batch, colors, rows, columns] = shape else { return None };
    let fixed = |dimension: &Dimension| match dimension {
        Dimension::Fixed(size) => Some(*size),
        Dimension::Symbolic(_) => None,
    };
    let size = [fixed(rows), fixed(columns)];
    let fits = fixed(batch).is_none_or(|n| n == 1) && fixed(colors).is_none_or(|n| n == 3);
    (fits && size.into_iter().flatten().all(|side| (1..=MOST_SIDE_PX).contains(&side))).then_some(size)
}

fn wrong_input(model: &Model, path: &Path, expected: &'static str) -> OnnxError {
    let inputs = model.input_ids().iter().filter_map(|&id| model.node_info(id));
    let found: Vec<String> = inputs.map(|info| described(&info)).collect();
    let found = if found.is_empty() { "nothing".to_owned() } else { found.join(", ") };
    OnnxError::Input { path: path.into(), found, expected }
}

/// Name, type and shape of an input, such as `x: f32 [1, 3, rows, 518]`.
fn described(info: &NodeInfo) -> String {
    let name = info.name().unwrap_or("an input without a name");
    let dtype = info.dtype().map_or_else(|| "unknown type".to_owned(), |dtype| dtype.to_string());
    let sides = info.shape().map(|shape| {
        let side = |dimension: &Dimension| match dimension {
            Dimension::Fixed(size) => size.to_string(),
            Dimension::Symbolic(name) => name.clone(),
        };
        shape.iter().map(side).collect::<Vec<_>>().join(", ")
    });
    match sides {
        Some(sides) => format!("`{name}`: {dtype} [{sides}]"),
        None => format!("`{name}`: {dtype} of any shape"),
    }
}
