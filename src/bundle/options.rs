//! Options of an adjustment.

use super::control::ControlPoint;
use super::correction::CorrectionModel;
use super::height_prior::HeightPrior;
use crate::checkpoint::PartStore;

/// Options of an adjustment.
#[derive(Clone, Debug, Default)]
pub struct BundleOptions {
    /// Keep the cameras as delivered: points are triangulated with them, and the report tells which corrections an
    /// adjustment would make.
    pub fixed: bool,
    /// Which parameters of a camera are corrected.
    pub model: CorrectionModel,
    /// Lowest and highest ellipsoidal height of the ground, metres; without it that of the scene.
    pub height_range: Option<(f64, f64)>,
    /// Surveyed points, which then define the datum.
    pub control: Vec<ControlPoint>,
    /// Names of reference views: their cameras are not corrected and define the datum.
    pub reference: Vec<String>,
    /// An elevation model as a prior of the heights.
    pub height_prior: Option<HeightPrior>,
    /// Largest side of the cells of ground by which a large scene is matched, metres; by default 1,000.
    pub cell_m: Option<f64>,
    /// Where keypoints, matches and the tie points of cells are stored, so that an interrupted adjustment need not find them again:
    /// those of cells in `cells`, the others in [`MATCHING`](crate::run_files::MATCHING). It depends on the scene's images and metadata.
    pub store: Option<PartStore>,
}
