//! Which pixels of an image show what other images do not: cars, clouds, people (SatGS, section 3.4; WildGaussians, Kulhanek et
//! al. 2024).
//!
//! Where the features of an image and of its render differ ([`dissimilarity`]), the image is uncertain: its pixels have the
//! visibility min(1 / (2 σ²), 1) in the photometric loss. σ minimises [`UncertaintyLoss`]: in closed form for each patch alone
//! ([`UncertaintyLoss::visibility`]), or as what an [`UncertaintyHead`] sees in the features of the image.

mod dissimilarity;
mod error;
mod head;
mod loss;
mod normalization;
mod upsample;

pub use dissimilarity::{SCALE, dissimilarity};
pub use error::UncertaintyError;
pub use head::{HeadState, UncertaintyHead};
pub use loss::{UncertaintyLoss, visibility_of_sigma};
pub use upsample::upsample;

#[cfg(test)]
mod head_tests;
