//! Options of a simulation.

use super::SimulateError;
use super::plan::Relief;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Numbers of images; the names of files have two digits.
const VIEWS: RangeInclusive<usize> = 3..=99;
/// Numbers of held-out images.
const HELD_OUT: RangeInclusive<usize> = 0..=99;
/// Columns and rows of an image.
const SIZE_PX: RangeInclusive<usize> = 64..=2048;
/// Ground sampling distances, metres.
const GSD_M: RangeInclusive<f64> = 0.2..=2.0;
/// Percent of the pixels that show cars or their shadows; streets full of cars reach the highest one.
const CARS_PERCENT: RangeInclusive<f64> = 0.0..=8.0;

/// Options of [`simulate`](super::simulate()).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulateOptions {
    /// Seed of the random numbers; another seed gives another town.
    pub seed: u64,
    /// Number of images.
    pub views: usize,
    /// Columns and rows of every image.
    pub size_px: usize,
    /// Ground sampling distance at nadir, metres; also the cell of the exact DSM.
    pub gsd_m: f64,
    /// Height differences of the terrain.
    pub relief: Relief,
    /// Whether the images are of all four seasons, with strong colours; without it, from March to October with mild ones.
    pub seasons: bool,
    /// Percent of the pixels of every image that show a moving car or its shadow; without it, there is light traffic.
    pub cars_percent: Option<f64>,
    /// Number of additional images to compare with, without cars and noise, at dates between those of the images.
    pub held_out: usize,
    /// Whether files of an earlier simulation in the folder are replaced.
    pub overwrite: bool,
}

impl Default for SimulateOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            views: 10,
            size_px: 400,
            gsd_m: 0.5,
            relief: Relief::Rolling,
            seasons: false,
            cars_percent: None,
            held_out: 0,
            overwrite: false,
        }
    }
}

impl SimulateOptions {
    /// Whether the truth of shadows, cars and colours is written.
    pub(super) fn has_appearance_truth(&self) -> bool {
        self.seasons || self.cars_percent.is_some() || self.held_out > 0
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`SimulateError::Option`].
    pub fn check(&self) -> Result<(), SimulateError> {
        let wrong = |option, found: String, expected| Err(SimulateError::Option { option, found, expected });
        if self.views < *VIEWS.start() {
            let expected = "3 to 99; a scene of two views is one of three from which an image is deleted";
            return wrong("--views", self.views.to_string(), expected);
        }
        if !VIEWS.contains(&self.views) {
            return wrong("--views", self.views.to_string(), "3 to 99");
        }
        if !SIZE_PX.contains(&self.size_px) {
            return wrong("--size", self.size_px.to_string(), "64 to 2048 pixels");
        }
        if !GSD_M.contains(&self.gsd_m) {
            return wrong("--gsd", self.gsd_m.to_string(), "0.2 to 2 metres");
        }
        if let Some(percent) = self.cars_percent
            && !CARS_PERCENT.contains(&percent)
        {
            return wrong("--cars", percent.to_string(), "0 to 8 percent of the pixels");
        }
        if !HELD_OUT.contains(&self.held_out) {
            return wrong("--held-out", self.held_out.to_string(), "0 to 99");
        }
        Ok(())
    }
}
