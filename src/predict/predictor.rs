//! What predicts splats: a trained model of the program's own, or a network of others as an ONNX file.

use super::model::ModelContent;
use super::network::graph::{INPUT_NAMES, inputs, onnx};
use super::network::{FeatureBlocks, NetworkEvaluation, NetworkInput, OUTPUTS};
use super::{Model, PredictError, SplatSampling};
use crate::io::{WriteError, write_file};
use crate::nn::onnx::NamedModel;
use std::path::Path;

/// Keys of the metadata of an ONNX file: the spacings of points as JSON, and how the network was made.
const SAMPLING: &str = "sampling";
const ORIGIN: &str = "origin";

/// What predicts splats.
pub struct Predictor {
    sampling: SplatSampling,
    network: Network,
}

enum Network {
    Own(Model),
    Onnx(Box<NamedModel>),
}

impl From<Model> for Predictor {
    fn from(model: Model) -> Self {
        Self { sampling: model.content.sampling, network: Network::Own(model) }
    }
}

impl Predictor {
    /// The model that comes with the program.
    ///
    /// # Errors
    /// [`PredictError::Format`] if the program was built with a damaged one.
    pub fn built_in() -> Result<Self, PredictError> {
        Ok(Model::built_in()?.into())
    }

    /// Reads a model that [`Model::write`] wrote, or, if the name ends in `.onnx`, a network with inputs and output as
    /// [`write_onnx`] has them.
    ///
    /// # Errors
    /// [`PredictError`] if the file cannot be read or is not such a model.
    pub fn read(path: &Path) -> Result<Self, PredictError> {
        if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("onnx")) {
            return Ok(Model::read(path)?.into());
        }
        let model = NamedModel::load(path, &INPUT_NAMES)?;
        let wrong = |reason: String| PredictError::Format { path: path.into(), reason };
        let sampling: SplatSampling = match model.metadata(SAMPLING) {
            Some(text) => serde_json::from_str(text).map_err(|e| wrong(format!("`{SAMPLING}`: {e}")))?,
            None => SplatSampling::default(),
        };
        sampling.check().map_err(wrong)?;
        Ok(Self { sampling, network: Network::Onnx(Box::new(model)) })
    }

    /// The spacings of points that it was trained with.
    #[must_use]
    pub fn sampling(&self) -> &SplatSampling {
        &self.sampling
    }

    /// The numbers of each query.
    ///
    /// # Errors
    /// [`PredictError::Onnx`] if a network of others cannot be evaluated.
    pub fn outputs(&self, input: &NetworkInput<f32>) -> Result<FeatureBlocks<f32>, PredictError> {
        match &self.network {
            Network::Own(Model { content, parameters }) => {
                Ok(NetworkEvaluation::new(&content.network).forward(parameters, input).clone())
            }
            Network::Onnx(model) => {
                let values = model.evaluate(inputs(input), [input.queries.items(), OUTPUTS])?;
                Ok(FeatureBlocks::of_rows(values.as_chunks::<OUTPUTS>().0))
            }
        }
    }
}

/// Writes a model as an ONNX file, whose inputs and output `network/graph.rs` lists.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_onnx(model: &Model, path: &Path) -> Result<(), WriteError> {
    let Model { content: ModelContent { network, sampling, origin }, parameters } = model;
    let sampling = serde_json::to_string(sampling).map_err(|e| WriteError::new(path, e))?;
    write_file(path, onnx(network, parameters, &[(SAMPLING, &sampling), (ORIGIN, origin)]))
}
