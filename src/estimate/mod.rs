//! What to expect of a run before it is made: time and memory, and the error of the heights.
//!
//! Whole scenes and tiles have one model of cost ([`RunSize`]), which `satgs info`, `satgs plan` and the first lines of
//! `satgs run` print.

mod cost;
mod device_memory;
mod expectation;
mod machine;

pub use cost::{Cost, RunSize};
pub use device_memory::{DeviceTraining, TILES_OF_SPLAT};
pub use expectation::{BEST_CONVERGENCE_DEG, Expectation, Imaging, best_convergence_deg};
pub use machine::measured_cores;
