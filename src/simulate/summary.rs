//! What a simulation reports.

use super::view::SimulatedView;
use crate::scene::Role;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Statistics of the exact DSM.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneFigures {
    /// Mean absolute deviation of the heights from their mean, metres: the MAE of a flat prediction.
    pub mean_absolute_deviation_m: f64,
    /// Fraction of the cells that are roofs.
    pub roofs_share: f64,
    /// Fraction of the cells that are trees.
    pub trees_share: f64,
    /// Fraction of the cells that are water.
    pub water_share: f64,
    /// Height of the tallest building above the ground, metres.
    pub tallest_building_m: f64,
    /// Difference between the highest and the lowest ground, metres.
    pub relief_m: f64,
}

/// How a surface that the user has was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFigures {
    /// The vertical reference of its heights.
    pub vertical: String,
    /// Whether neither the options nor the file state the vertical reference.
    pub vertical_is_assumed: bool,
    /// Share of the ground of the images without heights; images have no data there.
    pub holes_share: f64,
    /// Share of the ground of the images that no picture covers; it has a plain texture.
    pub untextured_share: f64,
}

/// Acquisition of one simulated image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewFigures {
    /// File name without extension.
    pub name: String,
    /// Whether the image is to be trained on or held out.
    pub role: Role,
    /// Angle between the vertical and the line of sight at the ground, degrees.
    pub off_nadir_deg: f64,
    /// True azimuth of the satellite, degrees.
    pub azimuth_deg: f64,
    /// True azimuth of the sun, degrees.
    pub sun_azimuth_deg: f64,
    /// Elevation of the sun, degrees.
    pub sun_elevation_deg: f64,
    /// Acquisition time, ISO 8601 in UTC.
    pub acquired: String,
    /// Column of the delivered RPC minus that of the true RPC, pixels.
    pub d_col: f64,
    /// Row of the delivered RPC minus that of the true RPC, pixels.
    pub d_row: f64,
    /// The truth of its shadows, cars and colours, if it was written.
    pub appearance: Option<AppearanceFigures>,
}

impl ViewFigures {
    pub(super) fn new(view: &SimulatedView, appearance: Option<AppearanceFigures>) -> Self {
        let plan = &view.plan;
        Self {
            name: plan.name.clone(),
            role: view.role,
            off_nadir_deg: plan.off_nadir_deg,
            azimuth_deg: plan.azimuth_deg,
            sun_azimuth_deg: plan.sun.azimuth_deg,
            sun_elevation_deg: plan.sun.elevation_deg,
            acquired: plan.acquired.clone(),
            d_col: plan.pointing_error.0,
            d_row: plan.pointing_error.1,
            appearance,
        }
    }
}

/// The known appearance of one image, and the pictures of it in `truth/appearance/`.
///
/// A grey level of the image is `offset + gain * radiance`, with noise of the standard deviation `noise`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AppearanceFigures {
    /// Grey levels per unit of radiance: red, green, blue.
    pub gain: [f64; 3],
    /// Grey levels of black (haze): red, green, blue.
    pub offset: [f64; 3],
    /// Standard deviation of the noise, grey levels.
    pub noise: f64,
    /// Mean reflectance of grass on this day: red, green, blue.
    pub grass: [f64; 3],
    /// Mean reflectance of tree crowns on this day: red, green, blue.
    pub trees: [f64; 3],
    /// Largest fraction of the ground's colour that is snow on this day.
    pub snow: f64,
    /// Percent of the pixels that show a car or its shadow.
    pub cars_percent: f64,
    /// The share of sunlight that reaches the surface at every pixel: 255 in full sun, 0 in shadow.
    pub sunlit: PathBuf,
    /// Pixels that show a car or its shadow: 255; the others: 0.
    pub cars: PathBuf,
    /// The image without cars and without noise, RGB.
    pub clean: PathBuf,
}

impl AppearanceFigures {
    /// Paths of its pictures.
    pub(super) fn paths_mut(&mut self) -> [&mut PathBuf; 3] {
        [&mut self.sunlit, &mut self.cars, &mut self.clean]
    }
}

/// Result of [`simulate`](super::simulate()).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Statistics of the scene.
    pub scene: SceneFigures,
    /// How the user's surface was taken, if it is one.
    pub surface: Option<SurfaceFigures>,
    /// The images, ordered by name within each role; held-out ones come last.
    pub views: Vec<ViewFigures>,
    /// Path of the exact DSM.
    pub truth: PathBuf,
}
