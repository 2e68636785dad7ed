//! The figures of a training.

use crate::splat::train::LogLine;
use serde::{Deserialize, Serialize};

/// The figures of a training.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trained {
    /// Iterations.
    pub iterations: u32,
    /// Time of the iterations, seconds.
    pub seconds: f64,
    /// Number of splats at the start.
    pub splats_start: usize,
    /// Number of splats at the end.
    pub splats: usize,
    /// Mean over the views of the root mean square distance between fitted camera and RPC, pixels; none of
    /// perspective scenes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub affine_rms_px: Option<f64>,
    /// Largest such distance in any view, pixels; likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub affine_max_px: Option<f64>,
    /// Mean absolute difference between rendered and real image, mean of the last iteration of every view.
    pub l1: f64,
    /// SSIM of rendered and real image, likewise.
    pub ssim: f64,
}

/// Mean of a column of the log over the last iteration of each of so many views.
pub(super) fn mean_of_last(log: &[LogLine], views: usize, column: &str) -> f64 {
    mean(log[log.len().saturating_sub(views)..].iter().map(|line| line.column(column)))
}

/// Mean of values; zero if there are none.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / f64::max(n, 1.0)
}
