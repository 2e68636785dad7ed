//! Dense features: a vector for each patch of a picture, by which pictures of one place are compared without regard to light.
//!
//! [`HandFeatures`] needs no weights. [`OnnxFeatures`] evaluates a network that a user brings, such as DINOv2 (Oquab et al. 2023)
//! as an ONNX file.

mod cells;
mod error;
mod hand;
mod map;
mod onnx;
mod tiles;

pub use error::FeatureError;
pub use hand::HandFeatures;
pub use map::{DenseFeatures, FeatureMap};
pub use onnx::OnnxFeatures;

#[cfg(test)]
mod onnx_tests;
