//! What `satgs export` wrote.

use serde::Serialize;
use std::path::PathBuf;

/// Views that were exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedViews {
    /// The folder.
    pub folder: PathBuf,
    /// The views.
    pub views: Vec<ExportedView>,
    /// Views that do not show the area, and were left out.
    pub left_out: Vec<String>,
    /// Number of points.
    pub points: usize,
    /// Mean distance of the points' observations from their projections, pixels; none without observations.
    pub reprojection_px: Option<f64>,
}

/// A view that was exported.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedView {
    /// Name of the image file.
    pub image: String,
    /// Columns and rows.
    pub size: (usize, usize),
    /// Whether the view was held back from training.
    pub is_test: bool,
    /// How its pinhole camera fits; none of photographs, whose camera is one.
    #[serde(flatten)]
    pub fit: Option<PinholeFit>,
}

/// The pinhole camera of a satellite's view.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PinholeFit {
    /// Distance of the camera from the site's origin, metres.
    pub distance_m: f64,
    /// Root mean square distance in the image between the run's camera of the view and the pinhole camera of the resampled
    /// image, pixels.
    pub rms_px: f64,
    /// The largest of these distances.
    pub max_px: f64,
}

/// Splats that were exported as one file.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedSplats {
    /// The file.
    pub file: PathBuf,
    /// Number of splats.
    pub splats: usize,
    /// Size of the file.
    pub bytes: u64,
    /// Distance of neighbouring coordinates, in their unit, if the format holds whole numbers of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
}

/// Splats that were exported as 3D Tiles.
#[derive(Clone, Debug, Serialize)]
pub struct ExportedTileset {
    /// Its document.
    pub tileset: PathBuf,
    /// Number of tiles.
    pub tiles: usize,
    /// Number of levels of detail.
    pub levels: usize,
    /// Number of splats of the most detailed level.
    pub splats: usize,
    /// Size of the files of all tiles.
    pub bytes: u64,
}
