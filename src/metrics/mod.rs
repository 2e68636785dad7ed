//! Scores of surface models against lidar: three registrations, errors after each, completeness. Scores of meshes.
//!
//! The order of work: [`HeightRaster::read`] and [`Truth::read`], [`evaluate`], then [`Evaluation::error_map`],
//! [`Evaluation::profiles`] and [`error_picture`]. Signs: `dz` is metres added to the prediction, `(dx, dy)` is where
//! the prediction is sampled, `registered[row, col] = P[row + dy, col + dx]`, so the prediction moves by `-dx` cells east
//! and `dy` cells north.

mod breakdown;
mod cloud;
mod error;
mod error_ranking;
mod evaluation;
mod figure;
mod fill;
mod ground;
mod mesh_scores;
mod ncc;
mod pattern_search;
mod phase;
mod profile;
mod registered;
mod registration;
mod resample;
mod scores;
mod shift_precision;
mod surface;
mod truth;
mod xyz;

pub use breakdown::{Division, PartScores};
pub use error::MetricsError;
pub use error_ranking::ErrorRanking;
pub use evaluation::{Evaluation, Evidence, RegisteredScores, evaluate, to_one_reference};
pub use figure::{ERRORS, ScaleWords, error_figure, error_picture, error_style};
pub use fill::filled_by_nearest;
pub use mesh_scores::{MeshScores, error_mesh, mesh_scores};
pub(crate) use pattern_search::PatternSearch;
pub use profile::Profile;
pub use registered::registered;
pub use registration::{Method, Registration, registrations};
pub use resample::{Sampling, onto_grid};
pub use scores::Scores;
pub(crate) use shift_precision::{
    MEDIAN_TO_MEAN, STENCIL, ShiftPrecision, block_costs, block_of, is_rival, median_sigma,
};
pub use surface::HeightRaster;
pub use truth::{Truth, TruthOptions, WATER, class_name};
