//! Image features of a network that a user brings as an ONNX file, such as DINOv2 (Point2GS, equation 4), beside those that need no
//! weights.

use super::PredictError;
use super::image_features::FEATURES;
use super::network::MOST_IMAGE_FEATURES;
use crate::affine::TrainingView;
use crate::frame::{CenterPx, Pixel};
use crate::io::{Grid2, vsi};
use crate::nn::features::{DenseFeatures, FeatureMap, OnnxFeatures};
use crate::progress::{Event, Progress};
use crate::splat::pinhole::PinholeView;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A network that gives a vector for each patch of an image.
pub struct ImageNetwork {
    network: Mutex<OnnxFeatures>,
    patch_px: usize,
    channels: usize,
    id: ImageNetworkId,
}

/// What a model knows of the network of image features that it was trained with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageNetworkId {
    /// The file.
    pub path: PathBuf,
    /// Hash of its content.
    pub hash: String,
    /// Number of image features of a key point with it: mean and standard deviation over the images.
    pub features: usize,
}

/// The vectors of the patches of some images.
pub struct NetworkMaps {
    maps: Vec<FeatureMap>,
    patch_px: usize,
    channels: usize,
}

impl ImageNetwork {
    /// Reads a network that takes and gives what [`OnnxFeatures`] does.
    ///
    /// # Errors
    /// [`PredictError::Features`] if it cannot be used, [`PredictError::Io`] if the file cannot be read.
    pub fn load(path: &Path) -> Result<Self, PredictError> {
        let network = OnnxFeatures::load(path)?;
        let io = |reason: String| PredictError::Io { path: path.into(), reason };
        let (patch_px, channels) = (network.patch_px(), network.channels());
        let features = FEATURES + 2 * channels;
        if features > MOST_IMAGE_FEATURES {
            return Err(io(format!("its vectors have {channels} numbers, which are too many")));
        }
        let hash = vsi::content_hash(path).map_err(|e| io(e.to_string()))?.to_hex().to_string();
        let id = ImageNetworkId { path: path.into(), hash, features };
        Ok(Self { network: Mutex::new(network), patch_px, channels, id })
    }

    /// By what a model knows it.
    #[must_use]
    pub fn id(&self) -> &ImageNetworkId {
        &self.id
    }

    /// The vectors of images, whose planes are red, green and blue as displayed.
    fn maps(
        &self,
        images: impl ExactSizeIterator<Item = [Grid2; 3]>,
        progress: &dyn Progress,
    ) -> Result<NetworkMaps, PredictError> {
        progress.event(Event::Started { stage: "computing image features", total: images.len() as u64 });
        let mut maps = Vec::with_capacity(images.len());
        for rgb in images {
            progress.check()?;
            // Nothing is half done after a panic of another thread.
            let mut network = self.network.lock().unwrap_or_else(PoisonError::into_inner);
            maps.push(network.extract(&rgb)?);
            progress.event(Event::Advanced { done: maps.len() as u64, status: String::new() });
        }
        progress.event(Event::Finished);
        Ok(NetworkMaps { maps, patch_px: self.patch_px, channels: self.channels })
    }

    /// The vectors of satellite images.
    ///
    /// # Errors
    /// [`PredictError::Features`] if the network cannot be evaluated, [`PredictError::Interrupted`].
    pub fn maps_of(
        &self,
        views: &[TrainingView],
        progress: &dyn Progress,
    ) -> Result<NetworkMaps, PredictError> {
        let displayed = |view: &TrainingView| {
            let shown = |rgb: [f32; 3]| rgb.map(|v| view.transfer_function.encoded(v));
            planes((view.width, view.height), |col, row| view.block_mean(col, row, 1).map(shown))
        };
        self.maps(views.iter().map(displayed), progress)
    }

    /// The vectors of photographs.
    ///
    /// # Errors
    /// [`PredictError::Features`] if the network cannot be evaluated, [`PredictError::Interrupted`].
    pub fn maps_of_photographs(
        &self,
        views: &[&PinholeView],
        progress: &dyn Progress,
    ) -> Result<NetworkMaps, PredictError> {
        let displayed = |view: &&PinholeView| planes(view.camera.size, |col, row| view.color(col, row));
        self.maps(views.iter().map(displayed), progress)
    }
}

impl NetworkMaps {
    /// The vectors of some of the images, in this order.
    #[must_use]
    pub fn of(&self, views: &[usize]) -> Self {
        let maps = views.iter().map(|view| self.maps[*view].clone()).collect();
        Self { maps, ..*self }
    }

    /// Length of the vectors.
    #[must_use]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The vector of the patch that a position of an image lies in; none outside of the image.
    #[must_use]
    pub fn at(&self, view: usize, p: Pixel<CenterPx>) -> Option<&[f32]> {
        let map = self.maps.get(view)?;
        let patch = |v: f64| ((v + 0.5) / self.patch_px as f64).floor();
        let (col, row) = (patch(p.col), patch(p.row));
        let is_inside = col >= 0.0 && row >= 0.0 && col < map.width as f64 && row < map.height as f64;
        is_inside.then(|| map.at(col as usize, row as usize))
    }
}

/// The planes of an image as displayed, black where it has no data.
fn planes((width, height): (usize, usize), color: impl Fn(usize, usize) -> Option<[f32; 3]>) -> [Grid2; 3] {
    [0, 1, 2].map(|k| Grid2::from_fn(width, height, |col, row| color(col, row).map_or(0.0, |rgb| rgb[k])))
}
