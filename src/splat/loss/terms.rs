//! What some loss terms need beside renders and splats.

use super::prior::Prior;
use crate::nn::lpips::Lpips;
use std::sync::Arc;

/// What some loss terms need; a term takes its own when it is made, and is zero without it.
pub struct TermInputs<T> {
    /// The surface of the term [`surface_prior`](super::surface_prior).
    pub prior: Option<Arc<Prior>>,
    /// The network of the term [`perceptual`](super::perceptual).
    pub lpips: Option<Lpips<T>>,
}

impl<T> Default for TermInputs<T> {
    fn default() -> Self {
        Self { prior: None, lpips: None }
    }
}
