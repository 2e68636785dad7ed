//! Scores of renders against images.

use crate::splat::image_score::PictureScore;
use serde::Serialize;

/// Scores of the views.
#[derive(Clone, Debug, Serialize)]
pub struct NvsScores {
    /// One entry a view.
    pub views: Vec<ViewScore>,
    /// Means over the views of a perspective scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean: Option<PictureScore>,
}

/// Score of one view.
#[derive(Clone, Debug, Serialize)]
pub struct ViewScore {
    /// Name of the view.
    pub view: String,
    /// PSNR and SSIM of the right half of the image, after a linear change of colours fitted on the left half;
    /// of the whole image and without a change of colours in perspective scenes.
    pub score: PictureScore,
}
