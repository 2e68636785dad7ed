//! What predicts splats: a trained model of the program's own, or a network of others as an ONNX file.

use super::model::{ModelContent, require};
use super::network::graph::{INPUT_NAMES, inputs, onnx};
use super::network::{FeatureBlocks, NetworkEvaluation, NetworkInput, OUTPUTS};
use super::{ImageNetwork, Model, PredictError, SplatSampling};
use crate::io::{WriteError, write_file};
use crate::nn::onnx::NamedModel;
use std::path::Path;

/// Keys of the metadata of an ONNX file: the spacings of points as JSON, how the network was made, and the hash of the network of image
/// features that it was trained with, if there was one.
const SAMPLING: &str = "sampling";
const ORIGIN: &str = "origin";
const IMAGE_NETWORK: &str = "image_network";

/// What predicts splats.
pub struct Predictor {
    sampling: SplatSampling,
    network: Network,
    image_network: Option<ImageNetwork>,
}

enum Network {
    Own(Model),
    Onnx(Box<NamedModel>),
}

impl From<Model> for Predictor {
    fn from(model: Model) -> Self {
        Self { sampling: model.content.sampling, network: Network::Own(model), image_network: None }
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
        Ok(Self { sampling, network: Network::Onnx(Box::new(model)), image_network: None })
    }

    /// With the network of image features that the model was trained with, if there was one.
    ///
    /// # Errors
    /// [`PredictError::OtherFeatures`] if it was trained with another one. An ONNX file that does not say so takes any.
    pub fn with_image_network(self, image_network: Option<ImageNetwork>) -> Result<Self, PredictError> {
        let needed = match &self.network {
            Network::Own(model) => Some(model.content.image_network.as_deref()),
            Network::Onnx(model) if model.metadata(ORIGIN).is_some() => Some(model.metadata(IMAGE_NETWORK)),
            Network::Onnx(_) => None,
        };
        if let Some(needed) = needed {
            require(needed, image_network.as_ref().map(ImageNetwork::id))?;
        }
        Ok(Self { image_network, ..self })
    }

    /// The network of image features, if the model takes them.
    #[must_use]
    pub fn image_network(&self) -> Option<&ImageNetwork> {
        self.image_network.as_ref()
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
                content.require(self.image_network.as_ref().map(ImageNetwork::id))?;
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
    let Model { content: ModelContent { network, sampling, origin, image_network }, parameters } = model;
    let sampling = serde_json::to_string(sampling).map_err(|e| WriteError::new(path, e))?;
    let mut metadata = vec![(SAMPLING, sampling.as_str()), (ORIGIN, origin)];
    metadata.extend(image_network.as_deref().map(|hash| (IMAGE_NETWORK, hash)));
    write_file(path, onnx(network, parameters, &metadata))
}
