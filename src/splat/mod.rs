//! The Gaussians, their rendering and their training.
