//! Tensors of finite float32 in safetensors files.

use safetensors::{Dtype, SafeTensors};

/// The values of a tensor of finite float32, whose shape must be as given where a size is given.
///
/// # Errors
/// A sentence that says what is wrong: no such tensor, another type or shape, or values that are not finite.
pub fn values(tensors: &SafeTensors, name: &str, expected: &[Option<usize>]) -> Result<Vec<f32>, String> {
    let tensor = tensors.tensor(name).map_err(|_| format!("it has no tensor `{name}`"))?;
    let fits = tensor.shape().len() == expected.len()
        && tensor.shape().iter().zip(expected).all(|(n, expected)| expected.is_none_or(|e| e == *n));
    if tensor.dtype() != Dtype::F32 || !fits {
        let shape = |n: &Option<usize>| n.map_or_else(|| "any".into(), |n| n.to_string());
        let expected: Vec<String> = expected.iter().map(shape).collect();
        return Err(format!(
            "tensor `{name}` is {:?} {:?}, expected F32 [{}]",
            tensor.dtype(),
            tensor.shape(),
            expected.join(", ")
        ));
    }
    let floats = tensor.data().as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
    let values: Vec<f32> = floats.collect();
    if values.iter().all(|v| v.is_finite()) {
        Ok(values)
    } else {
        Err(format!("tensor `{name}` has values that are not finite"))
    }
}
