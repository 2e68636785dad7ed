//! What to render.

use serde::Serialize;
use std::path::PathBuf;

/// Where an image is taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewpoint {
    /// The camera, sun and colours of a view of the run.
    Like(String),
    /// A direction, in the colours of the reference view.
    Direction {
        /// Azimuth (clockwise from north) and angle off nadir, degrees.
        from_deg: [f64; 2],
        /// The same for the last frame.
        to_deg: Option<[f64; 2]>,
        /// Columns and rows; by default the area in pixels of the reference view.
        size: Option<(usize, usize)>,
    },
}

impl Default for Viewpoint {
    /// Straight down.
    fn default() -> Self {
        Self::Direction { from_deg: [0.0; 2], to_deg: None, size: None }
    }
}

/// What to render.
#[derive(Clone, Debug, Default)]
pub struct RenderOptions {
    /// Where the image is taken from.
    pub viewpoint: Viewpoint,
    /// Azimuth (clockwise from north) and elevation of the sun, degrees; by default the sun of a [`Viewpoint::Like`], else
    /// no shadows.
    pub sun_deg: Option<[f64; 2]>,
    /// The same for the last frame.
    pub sun_to_deg: Option<[f64; 2]>,
    /// Number of frames of an animation, written as `FILE_0001` and so on; by default one image.
    pub frames: Option<u32>,
    /// Write only the depth along the optical axis, as a `.tif`; of views of perspective scenes.
    pub depth: bool,
}

/// What was rendered.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RenderSummary {
    /// The file as it was asked for; frames have a number in their name.
    pub output: PathBuf,
    /// Number of images.
    pub frames: u32,
}
