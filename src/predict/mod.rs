//! Points to splats in one pass (Point2GS): a network predicts splats from a cloud of points and the images that show it.
//!
//! 1. [`Cloud`]: any cloud is cleaned, and the plane around each point computed.
//! 2. [`ImageObserver`]: what the images show of a position: colour, visibility, sunlight, features; [`light`] makes
//!    the colours of all dates alike.
//! 3. [`tiles`]: the area is processed in tiles that overlap. In each, [`key_points`] are chosen by farthest-point sampling and
//!    [`queries`] by sampling occupied voxels, and [`input`] lists their numbers.
//! 4. [`network`] computes fourteen numbers for each query, which [`head`] makes splats of.
//!
//! [`learn`] trains the network on towns of the simulator. [`reference`](mod@reference) makes splats of the same points without a network, to
//! compare with. Lengths are metres of the site frame.

mod cloud;
pub mod error;
pub mod head;
pub mod image_features;
pub mod image_network;
pub mod input;
pub mod key_points;
pub mod learn;
pub mod light;
pub mod model;
pub mod network;
pub mod observer;
pub mod photographs;
pub mod predictor;
pub mod queries;
pub mod reference;
#[cfg(test)]
mod tests;
pub mod tiles;

pub use cloud::{CleanUp, Cloud, FEWEST_POINTS, is_within};
pub use error::PredictError;
pub use image_network::ImageNetwork;
pub use model::Model;
pub use observer::{ImageObserver, ImageSample};
pub use predictor::{Predictor, write_onnx};
pub use tiles::predict;

use serde::{Deserialize, Serialize};

/// The spacings of points that a model was trained with, in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplatSampling {
    /// Distance of the splats on level ground.
    pub spacing_m: f64,
    /// Distance of the key points.
    pub key_spacing_m: f64,
    /// Whether splats are sampled in occupied voxels; without it each key point becomes one splat.
    pub densify: bool,
    /// Whether splats move from where they were sampled.
    pub offsets: bool,
}

/// Spacings of points that are possible, metres.
const SPACINGS_M: std::ops::RangeInclusive<f64> = 0.01..=100.0;

impl SplatSampling {
    /// A sentence that says which spacing is out of range, if one is.
    fn check(&self) -> Result<(), String> {
        let Self { spacing_m, key_spacing_m, .. } = self;
        let is_sound = [spacing_m, key_spacing_m].iter().all(|m| SPACINGS_M.contains(*m));
        let wrong =
            || format!("its spacings of {spacing_m} and {key_spacing_m} m are not between 0.01 and 100 m");
        if is_sound { Ok(()) } else { Err(wrong()) }
    }
}

impl Default for SplatSampling {
    fn default() -> Self {
        Self { spacing_m: 0.5, key_spacing_m: 2.0, densify: true, offsets: true }
    }
}
