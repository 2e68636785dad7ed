//! Runs of satellite scenes: training for heights, and for colours (`appearance/`), images from any direction, scores.

mod appearance;
mod device;
mod render;
mod scores;
mod train;
mod training;

pub(super) use render::render;
pub(super) use scores::nvs_eval;
pub(super) use train::train_locked;
