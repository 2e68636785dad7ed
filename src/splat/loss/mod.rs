//! The terms of the training loss.

pub mod consistency;
pub mod photometric;
pub mod surface_prior;
pub mod target;
