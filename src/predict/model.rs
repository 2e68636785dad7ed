//! Trained models that predict splats, and their files.
//!
//! A file holds one float32 tensor, `parameters` (in the order of [`SplatNetwork`]). The metadata hold the shape of the network, the
//! spacings of points that it was trained with, and how it was made.

use super::image_features::FEATURES;
use super::image_network::ImageNetworkId;
use super::network::SplatNetwork;
use super::{PredictError, SplatSampling};
use crate::io::{WriteError, write_file};
use crate::nn::tensors::values;
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;

/// The only key of the metadata: the kind and version of the file.
const FORMAT: &str = "satgs points to splats 2";
/// Name of the tensor.
const PARAMETERS: &str = "parameters";
/// The model that comes with the program.
const BUILT_IN: &[u8] = include_bytes!("../../data/models/points-to-splats.safetensors");

/// A trained model.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Shape and origin.
    pub content: ModelContent,
    /// Parameters of the network.
    pub parameters: Vec<f32>,
}

/// What the metadata of a file hold.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ModelContent {
    /// Shape of the network.
    pub network: SplatNetwork,
    /// Spacings of points.
    pub sampling: SplatSampling,
    /// How the model was made: the program's version and the configuration of the training.
    pub origin: String,
    /// Hash of the file of the network whose image features it was trained with, if there was one.
    #[serde(default)]
    pub image_network: Option<String>,
}

impl ModelContent {
    /// Checks that a network of image features is the one that the model was trained with.
    ///
    /// # Errors
    /// [`PredictError::OtherFeatures`] if it is not.
    pub fn require(&self, image_network: Option<&ImageNetworkId>) -> Result<(), PredictError> {
        require(self.image_network.as_deref(), image_network)?;
        let (needed, given) = (self.network.image_features, image_network.map_or(FEATURES, |n| n.features));
        let wrong = || format!("takes {needed} image features, but {given} are given");
        if needed == given { Ok(()) } else { Err(PredictError::OtherFeatures { needed: wrong() }) }
    }

    /// Whether the numbers of image features are possible.
    fn is_sound(&self) -> bool {
        let own = self.network.image_features;
        let fits = if self.image_network.is_some() { own > FEATURES } else { own == FEATURES };
        self.network.is_sound() && fits
    }
}

/// Checks that a network of image features is the one with this hash.
pub fn require(needed: Option<&str>, given: Option<&ImageNetworkId>) -> Result<(), PredictError> {
    let needed = match (needed, given) {
        (None, None) => return Ok(()),
        (Some(needed), Some(given)) if needed == given.hash => return Ok(()),
        (None, Some(given)) => {
            format!(
                "was trained without a network of image features, so that it has no use for `{}`",
                given.path.display()
            )
        }
        (Some(_), None) => "was trained with a network of image features".into(),
        (Some(_), Some(given)) => {
            format!("was trained with another network of image features than `{}`", given.path.display())
        }
    };
    Err(PredictError::OtherFeatures { needed })
}

impl Model {
    /// A model that is not trained: its splats lie flat on the surface in the colours of the images.
    #[cfg(test)]
    pub fn untrained(content: ModelContent, seed: u64) -> Self {
        let parameters = content.network.start(seed);
        Self { content, parameters }
    }

    /// The model that comes with the program.
    ///
    /// # Errors
    /// [`PredictError::Format`] if the program was built with a damaged one.
    pub fn built_in() -> Result<Self, PredictError> {
        let path = "the model of the program".into();
        decode(BUILT_IN).map_err(|reason| PredictError::Format { path, reason })
    }

    /// Hash of the file of the model that comes with the program.
    #[must_use]
    pub fn built_in_hash() -> String {
        blake3::hash(BUILT_IN).to_hex().to_string()
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`PredictError`] if it cannot be read, is cut short, of another version, or of other sizes than it states.
    pub fn read(path: &Path) -> Result<Self, PredictError> {
        let io = |e: std::io::Error| PredictError::Io { path: path.into(), reason: e.to_string() };
        let bytes = std::fs::read(path).map_err(io)?;
        decode(&bytes).map_err(|reason| PredictError::Format { path: path.into(), reason })
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let content = serde_json::to_string(&self.content).map_err(|e| WriteError::new(path, e))?;
        let bytes: Vec<u8> = self.parameters.iter().flat_map(|v| v.to_le_bytes()).collect();
        let tensor = TensorView::new(Dtype::F32, vec![self.parameters.len()], &bytes);
        let tensor = tensor.map_err(|e| WriteError::new(path, e))?;
        let metadata = HashMap::from([(FORMAT.to_owned(), content)]);
        let file = safetensors::serialize([(PARAMETERS, tensor)], Some(metadata));
        write_file(path, file.map_err(|e| WriteError::new(path, e))?)
    }
}

/// The model in the bytes of a file; an error says what is wrong.
fn decode(bytes: &[u8]) -> Result<Model, String> {
    let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| e.to_string())?;
    let metadata = header.metadata().clone().unwrap_or_default();
    let text = metadata.get(FORMAT).ok_or_else(|| format!("its metadata lack `{FORMAT}`"))?;
    let content: ModelContent = serde_json::from_str(text).map_err(|e| format!("`{FORMAT}`: {e}"))?;
    content.sampling.check()?;
    if !content.is_sound() {
        return Err("the shape of its network is out of range".into());
    }
    let tensors = SafeTensors::deserialize(bytes).map_err(|e| e.to_string())?;
    let parameters = values(&tensors, PARAMETERS, &[Some(content.network.parameters())])?;
    Ok(Model { content, parameters })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predict::learn::LearnConfig;

    fn small() -> Model {
        let network = SplatNetwork { width: 8, ..SplatNetwork::default() };
        Model::untrained(ModelContent { network, origin: "a test".into(), ..ModelContent::default() }, 1)
    }

    #[test]
    fn files_are_read_back_and_have_the_same_bytes_each_time() {
        let folder = tempfile::tempdir().unwrap();
        let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
        small().write(&a).unwrap();
        small().write(&b).unwrap();
        assert_eq!(Model::read(&a).unwrap(), small());
        assert_eq!(std::fs::read(a).unwrap(), std::fs::read(b).unwrap());
    }

    #[test]
    fn damaged_files_and_those_of_other_sizes_are_refused_with_the_reason() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let reason = |model: &Model| {
            model.write(&path).unwrap();
            Model::read(&path).unwrap_err().to_string()
        };
        let mut other = small();
        other.parameters.pop();
        assert!(reason(&other).contains("`parameters`"), "{}", reason(&other));
        let mut other = small();
        other.content.network.width = 0;
        assert!(reason(&other).contains("shape"), "{}", reason(&other));
        let mut other = small();
        other.parameters[3] = f32::NAN;
        assert!(reason(&other).contains("not finite"), "{}", reason(&other));
        let mut other = small();
        other.content.sampling.spacing_m = f64::NAN;
        assert!(
            Model::read(&{
                other.write(&path).unwrap();
                path.clone()
            })
            .is_err()
        );
        small().write(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for cut in [0, 7, 60, bytes.len() / 2, bytes.len() - 1] {
            assert!(decode(&bytes[..cut]).is_err(), "{cut}");
        }
        assert!(matches!(Model::read(&folder.path().join("none")), Err(PredictError::Io { .. })));
    }

    #[test]
    fn the_built_in_model_can_be_read_and_is_small() {
        let model = Model::built_in().unwrap();
        assert_eq!(model.content.origin, LearnConfig::default().origin(), "it is to be trained again");
        assert!(BUILT_IN.len() < 1_000_000);
    }
}
