//! Priors: what a network, a sensor or a surface says of the depths and normals that views see, before any training.
//!
//! [`PriorFolder`] reads maps from files, which [`make_maps`] makes with a network or a command, or
//! by matching the photographs. [`read_priors`] reads those of
//! all views, and compares them with the points of the scene: what contradicts them is refused. [`bring_together`] gives depths the
//! scale of the scene. [`dense_start`] adds points to start from where the scene has few; [`aligned_start`] puts one behind each pixel.

mod agreement;
mod aligned_start;
mod command;
mod conjugate_gradients;
mod dense;
mod depth_normals;
mod error;
mod fit;
mod folder;
mod hdd;
mod inpaint;
mod integration;
mod make;
mod map;
mod multi_view;
mod network;
mod normal_axes;
mod of_sensor;
mod of_views;
mod process;
mod pseudo_views;
mod resample;
mod seen;
mod source;
mod stereo;

pub use aligned_start::{AlignedStart, Completion, StartView, UnseenPixels, aligned_start};
pub use command::PriorCommand;
pub use dense::{DenseSummary, DenseView, dense_start};
pub use error::PriorError;
pub use folder::{PriorDescription, PriorFolder};
pub use hdd::{AlignedDepth, AlignmentQuality, FEWEST_POINTS};
pub use inpaint::InpaintCommand;
pub use make::{ExistingMaps, MadeMaps, make_maps};
pub use map::{DepthKind, DepthPrior, NormalPrior, PixelColor, PriorContent, ViewPriors};
pub use multi_view::bring_together;
pub use normal_axes::NormalAxes;
pub use of_sensor::sensor_priors;
pub use of_views::{PriorSources, read_priors};
pub use pseudo_views::PseudoView;
pub(crate) use seen::seen_points;
pub use source::{PriorMaker, PriorSource};
pub use stereo::stereo_points;

#[cfg(test)]
mod make_tests;
#[cfg(test)]
mod tests;
