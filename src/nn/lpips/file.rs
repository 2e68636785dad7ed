//! Weights from a safetensors file.

use super::architecture::Backbone;
use super::error::LpipsError;
use super::network::Network;
use crate::simd::SimdReal;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use std::path::Path;

/// Reads a network.
pub(super) fn read<T: SimdReal>(path: &Path) -> Result<(Backbone, Network<T>), LpipsError> {
    let bytes = std::fs::read(path).map_err(|source| LpipsError::Read { path: path.into(), source })?;
    let tensors = SafeTensors::deserialize(&bytes)
        .map_err(|source| LpipsError::Format { path: path.into(), source })?;
    let file = WeightFile { path, tensors };
    let first = file.view("features.0.weight", None)?;
    let backbone = Backbone::of_first_weights(first.shape())
        .ok_or_else(|| LpipsError::Backbone { path: path.into(), found: first.shape().into() })?;
    let network = Network::new(&backbone.architecture(), |name, shape| file.values(name, shape, backbone))?;
    Ok((backbone, network))
}

/// A file in memory.
struct WeightFile<'a> {
    path: &'a Path,
    tensors: SafeTensors<'a>,
}

impl WeightFile<'_> {
    /// A tensor as it is stored.
    fn view(&self, name: &str, backbone: Option<Backbone>) -> Result<TensorView<'_>, LpipsError> {
        let missing = |_| LpipsError::Missing { path: self.path.into(), tensor: name.into(), backbone };
        self.tensors.tensor(name).map_err(missing)
    }

    /// The values of a tensor of f32 that has the expected shape.
    fn values<T: SimdReal>(
        &self,
        name: &str,
        expected: &[usize],
        backbone: Backbone,
    ) -> Result<Vec<T>, LpipsError> {
        let (path, tensor) = (|| self.path.into(), || name.to_owned());
        let view = self.view(name, Some(backbone))?;
        if view.shape() != expected {
            let (found, expected) = (view.shape().into(), expected.into());
            return Err(LpipsError::Shape { path: path(), tensor: tensor(), found, expected });
        }
        if view.dtype() != Dtype::F32 {
            let found = format!("{:?}", view.dtype());
            return Err(LpipsError::Type { path: path(), tensor: tensor(), found });
        }
        let values = view.data().as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes));
        if let Some((index, found)) = values.clone().enumerate().find(|(_, value)| !value.is_finite()) {
            return Err(LpipsError::NotFinite { path: path(), tensor: tensor(), index, found });
        }
        Ok(values.map(|value| T::from_f64(f64::from(value))).collect())
    }
}
