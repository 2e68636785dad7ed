//! Options of a simulation.

use super::SimulateError;
use super::plan::Relief;
use super::terrain::Terrain;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Numbers of images; the names of files have two digits.
const VIEWS: RangeInclusive<usize> = 2..=99;
/// Numbers of held-out images.
const HELD_OUT: RangeInclusive<usize> = 0..=99;
/// Columns and rows of an image.
pub(super) const SIZE_PX: RangeInclusive<usize> = 64..=2048;
/// Ground sampling distances, metres.
const GSD_M: RangeInclusive<f64> = 0.2..=2.0;
/// Percent of the pixels that show cars or their shadows; streets full of cars reach the highest one.
const CARS_PERCENT: RangeInclusive<f64> = 0.0..=8.0;

/// Angles from the vertical to a satellite, degrees: an RPC describes no image that is more oblique.
const OFF_NADIR_DEG: RangeInclusive<f64> = 0.0..=45.0;
/// Largest angle from the vertical to a satellite unless views are chosen, degrees.
const LARGEST_OFF_NADIR_DEG: f64 = 29.0;

/// Bits of a grey level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "u32", try_from = "u32")]
pub enum BitDepth {
    /// 8 bits: levels up to 255.
    Eight,
    /// 16 bits, of which 12 are used as sensors do: levels up to 4,095.
    Sixteen,
}

impl BitDepth {
    /// The highest grey level.
    pub(super) const fn white(self) -> u16 {
        match self {
            Self::Eight => 255,
            Self::Sixteen => 4095,
        }
    }
}

impl From<BitDepth> for u32 {
    fn from(depth: BitDepth) -> Self {
        match depth {
            BitDepth::Eight => 8,
            BitDepth::Sixteen => 16,
        }
    }
}

impl TryFrom<u32> for BitDepth {
    type Error = SimulateError;

    fn try_from(bits: u32) -> Result<Self, SimulateError> {
        match bits {
            8 => Ok(Self::Eight),
            16 => Ok(Self::Sixteen),
            _ => {
                Err(SimulateError::Option { option: "--bits", found: bits.to_string(), expected: "8 or 16" })
            }
        }
    }
}

/// Direction and time of an image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlannedView {
    /// Angle between the vertical and the line of sight at the ground, degrees.
    pub off_nadir_deg: f64,
    /// True azimuth of the satellite, seen from the ground, degrees.
    pub azimuth_deg: f64,
    /// Time, `YYYY-MM-DDThh:mm:ssZ`, from which the sun follows; without it, a late morning as other images have.
    pub acquired: Option<String>,
}

/// Options of [`simulate`](super::simulate()).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulateOptions {
    /// Seed of the random numbers; another seed gives another town.
    pub seed: u64,
    /// Number of images; of no meaning if directions are planned.
    pub views: usize,
    /// Directions and times of the images; if there are none, the directions of `views` images are spread over a cap of the
    /// sky, and their dates over the year.
    pub planned: Vec<PlannedView>,
    /// Columns and rows of every image.
    pub size_px: usize,
    /// Ground sampling distance at nadir, metres; also the cell of the exact DSM.
    pub gsd_m: f64,
    /// What the satellites look at.
    pub terrain: Terrain,
    /// Bits of the grey levels.
    pub depth: BitDepth,
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
            planned: Vec::new(),
            size_px: 400,
            gsd_m: 0.5,
            terrain: Terrain::Town(Relief::Rolling),
            depth: BitDepth::Eight,
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

    /// Number of images that are not held out.
    pub(super) fn count(&self) -> usize {
        if self.planned.is_empty() { self.views } else { self.planned.len() }
    }

    /// The largest angle from the vertical to a satellite, degrees.
    pub(super) fn largest_off_nadir_deg(&self) -> f64 {
        let planned = self.planned.iter().map(|view| view.off_nadir_deg);
        planned.reduce(f64::max).unwrap_or(LARGEST_OFF_NADIR_DEG)
    }

    /// Checks that every number is in its range.
    ///
    /// # Errors
    /// [`SimulateError::Option`].
    pub fn check(&self) -> Result<(), SimulateError> {
        let wrong = |option, found: String, expected| Err(SimulateError::Option { option, found, expected });
        let option = if self.planned.is_empty() { "--views" } else { "number of --view" };
        if !VIEWS.contains(&self.count()) {
            return wrong(option, self.count().to_string(), "2 to 99");
        }
        for view in &self.planned {
            if !OFF_NADIR_DEG.contains(&view.off_nadir_deg) || !view.azimuth_deg.is_finite() {
                let found = format!("{},{}", view.off_nadir_deg, view.azimuth_deg);
                return wrong(
                    "--view",
                    found,
                    "an angle from the vertical of 0 to 45 degrees and an azimuth",
                );
            }
        }
        if !SIZE_PX.contains(&self.size_px) {
            return wrong("--size", self.size_px.to_string(), "64 to 2048 pixels");
        }
        if !GSD_M.contains(&self.gsd_m) {
            return wrong("--gsd", self.gsd_m.to_string(), "0.2 to 2 metres");
        }
        if self.cars_percent.is_some() && !self.terrain.has_streets() {
            return wrong("--cars", "given".to_owned(), "no cars where there are no streets");
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
