//! Scores of renders against images.

use crate::splat::image_score::PictureScore;
use serde::Serialize;
use std::path::PathBuf;

/// Scores of the views.
#[derive(Clone, Debug, Serialize)]
pub struct NvsScores {
    /// How the colours of satellite views that were not trained on are chosen; none for perspective scenes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<Protocol>,
    /// One entry a view.
    pub views: Vec<ViewScore>,
    /// Means over the views, where there is one colour model for all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean: Option<PictureScore>,
}

/// Score of one view.
#[derive(Clone, Debug, Serialize)]
pub struct ViewScore {
    /// Name of the view.
    pub view: String,
    /// The score of the view's image by the [`Protocol`]; of the whole image and without a change of colours in perspective
    /// scenes.
    pub score: PictureScore,
    /// Of a view of a perspective scene that started from aligned depths: the parts that training views see and do not see.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parts: Option<SeenScores>,
}

/// Peak signal-to-noise ratios of the parts of a view, dB; none for parts without pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SeenScores {
    /// Share of the pixels that show what no training view sees.
    pub unseen_share: f64,
    /// Of these pixels.
    pub unseen_psnr_db: Option<f64>,
    /// Of the others.
    pub seen_psnr_db: Option<f64>,
}

/// How the colours of a satellite view that was not trained on are chosen before its render is scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Protocol {
    /// They are fitted on the whole image, and the whole image is scored (SatGS): the embedding of a colour model with networks.
    Full,
    /// They are fitted on the left half, and the right half is scored (NeRF in the Wild): the embedding, or a linear map of
    /// colours for models without networks.
    Half,
    /// They are those of the training view taken at the nearest time, and the whole image is scored (Sat-NeRF).
    Nearest,
}

/// What is scored, and how.
#[derive(Clone, Debug, Default)]
pub struct NvsOptions {
    /// Names of the views; all test views if there are none.
    pub views: Vec<String>,
    /// How the colours of a satellite view are chosen; by default [`Protocol::Full`] where the run has trained colours, else
    /// [`Protocol::Half`].
    pub protocol: Option<Protocol>,
    /// Safetensors file of the network of the perceptual distance; none for scores without it.
    pub lpips: Option<PathBuf>,
}

impl NvsScores {
    /// Scores with their means.
    pub(super) fn with_mean(views: Vec<ViewScore>) -> Self {
        let n = views.len() as f64;
        let mean = |of: &dyn Fn(&PictureScore) -> f64| views.iter().map(|v| of(&v.score)).sum::<f64>() / n;
        let has_lpips = views.iter().all(|v| v.score.lpips.is_some());
        let mean = PictureScore {
            psnr_db: mean(&|s| s.psnr_db),
            ssim: mean(&|s| s.ssim),
            ssim_3px: mean(&|s| s.ssim_3px),
            ssim_sat_nerf: mean(&|s| s.ssim_sat_nerf),
            lpips: has_lpips.then(|| mean(&|s| s.lpips.unwrap_or(f64::NAN))),
            pixels: views.iter().map(|v| v.score.pixels).sum(),
        };
        Self { protocol: None, views, mean: Some(mean) }
    }
}
