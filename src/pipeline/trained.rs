//! The figures of a training.

use super::run_folder::stage::Outcome;
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
    pub camera_rms_px: Option<f64>,
    /// Largest such distance in any view, pixels; likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_max_px: Option<f64>,
    /// Mean absolute difference between rendered and real image, mean of the last iteration of every view; none without an
    /// iteration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub l1: Option<f64>,
    /// SSIM of rendered and real image, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ssim: Option<f64>,
    /// Name of the GPU that trained; none of the processor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// The training of colours for novel views that follows in some recipes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colors: Option<TrainedColors>,
}

/// The figures of a training of colours.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainedColors {
    /// Iterations.
    pub iterations: u32,
    /// Time of the iterations, seconds.
    pub seconds: f64,
    /// Number of splats at the end.
    pub splats: usize,
    /// Mean absolute difference between rendered and real image as displayed, mean of the last iteration of every view.
    pub l1: f64,
    /// SSIM of rendered and real image, likewise.
    pub ssim: f64,
}

impl Outcome<Trained> {
    /// The figures with those of the training of colours that followed; made if one of the two was.
    pub(super) fn with_colors(self, colors: Outcome<TrainedColors>) -> Self {
        let is_made = matches!(self, Self::Made(_)) || matches!(colors, Outcome::Made(_));
        let with = |trained: Trained| Trained { colors: colors.summary().cloned(), ..trained };
        match self {
            Self::Made(trained) | Self::Kept(Some(trained)) if is_made => Self::Made(with(trained)),
            Self::Made(trained) => Self::Made(trained),
            Self::Kept(trained) => Self::Kept(trained.map(with)),
        }
    }
}

/// Mean of values; NaN if there are none.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / n
}
