//! Options of a simulated room.

use crate::simulate::SimulateError;
use crate::simulate::perspective::StatedCamera;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Numbers of images; fewer do not see all of the room.
const VIEWS: RangeInclusive<usize> = 6..=999;
/// Columns and rows of an image.
const SIZE_PX: RangeInclusive<usize> = 32..=2048;

/// Options of [`simulate_room`](super::simulate_room).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomOptions {
    /// Seed of the random numbers; another seed gives other cameras, textures and errors.
    pub seed: u64,
    /// Number of images.
    pub views: usize,
    /// Columns and rows of every image.
    pub size_px: usize,
    /// Also writes RGB-D frames, and which camera these state.
    #[serde(default)]
    pub frames: Option<StatedCamera>,
    /// Whether files of an earlier simulation in the folder are replaced.
    pub overwrite: bool,
}

impl Default for RoomOptions {
    fn default() -> Self {
        Self { seed: 0, views: 60, size_px: 640, frames: None, overwrite: false }
    }
}

impl RoomOptions {
    /// Checks that every number is in its range.
    pub(super) fn check(&self) -> Result<(), SimulateError> {
        let wrong = |option, found: usize, expected| {
            Err(SimulateError::Option { option, found: found.to_string(), expected })
        };
        if !VIEWS.contains(&self.views) {
            return wrong("--views", self.views, "6 to 999 with --room");
        }
        if !SIZE_PX.contains(&self.size_px) {
            return wrong("--size", self.size_px, "32 to 2048 pixels");
        }
        Ok(())
    }
}
