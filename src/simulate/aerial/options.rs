//! Options of simulated photographs from the air.

use crate::simulate::{Relief, SimulateError};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Numbers of images: three to train on, and one to compare with at least.
const VIEWS: RangeInclusive<usize> = 4..=999;
/// Columns and rows of an image.
const SIZE_PX: RangeInclusive<usize> = 32..=2048;

/// Options of [`simulate_aerial`](super::simulate_aerial).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AerialOptions {
    /// Seed of the random numbers; the town is that of satellite images with the same seed.
    pub seed: u64,
    /// Number of images.
    pub views: usize,
    /// Columns and rows of every image, which shows about 260 to 300 m of ground whatever its size.
    pub size_px: usize,
    /// Height differences of the terrain.
    pub relief: Relief,
    /// Whether files of an earlier simulation in the folder are replaced.
    pub overwrite: bool,
}

impl Default for AerialOptions {
    fn default() -> Self {
        Self { seed: 0, views: 21, size_px: 512, relief: Relief::Rolling, overwrite: false }
    }
}

impl AerialOptions {
    /// Checks that every number is in its range.
    pub(super) fn check(&self) -> Result<(), SimulateError> {
        let wrong = |option, found: usize, expected| {
            Err(SimulateError::Option { option, found: found.to_string(), expected })
        };
        if !VIEWS.contains(&self.views) {
            return wrong("--views", self.views, "4 to 999 with --aerial");
        }
        if !SIZE_PX.contains(&self.size_px) {
            return wrong("--size", self.size_px, "32 to 2048 pixels");
        }
        Ok(())
    }
}
