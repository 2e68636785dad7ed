//! The tie points of a cell of ground, as they are stored.

use serde::{Deserialize, Serialize};

/// A track of a cell.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CellTrack {
    /// Gray value of the point, 0 to 255.
    pub(super) gray: u8,
    /// Its observations.
    pub(super) observations: Vec<CellObservation>,
}

/// An observation of a track of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct CellObservation {
    /// Index of the view in the scene.
    pub(super) view: u32,
    /// Column and row in the whole image; (0, 0) is the centre of the first pixel.
    pub(super) px: [f64; 2],
    /// Weight relative to other observations.
    pub(super) weight: f64,
}

/// What a cell gave: its tracks, or the reason why it has none.
pub(super) type CellResult = Result<Vec<CellTrack>, String>;
