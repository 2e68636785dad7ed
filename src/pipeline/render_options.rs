//! What to render.

use serde::Serialize;
use std::path::PathBuf;

/// Where an image is taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewpoint {
    /// The camera, sun and colours of a view of the run.
    Like(String),
    /// The camera of a training view of a run with trained colours; not its colours are rendered but the visibility of its
    /// pixels: low where its image shows what the others do not.
    Visibility(String),
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

/// A time within a year and a day.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// Days since 1 January 2000, 12 h UTC, of noon of the date ([`days_of`](crate::scene::days_of)).
    pub noon: f64,
    /// Time of day, hours UTC; by default the median of the training views.
    pub hour: Option<f64>,
}

/// Whose colours an image has, in a run with trained colours.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Colors {
    /// Those of the view of [`Viewpoint::Like`], else of the reference view.
    #[default]
    OfViewpoint,
    /// Those of a training view.
    OfView(String),
    /// Those between the training views before and after a date in the course of a year, under the sun of the time.
    At {
        /// The moment.
        from: Moment,
        /// The moment of the last frame.
        to: Option<Moment>,
    },
}

/// What to render.
#[derive(Clone, Debug, Default)]
pub struct RenderOptions {
    /// Where the image is taken from.
    pub viewpoint: Viewpoint,
    /// Whose colours the image has.
    pub colors: Colors,
    /// Azimuth (clockwise from north) and elevation of the sun, degrees; by default that of a date, else the sun of a [`Viewpoint::Like`], else
    /// no shadows.
    pub sun_deg: Option<[f64; 2]>,
    /// The same for the last frame.
    pub sun_to_deg: Option<[f64; 2]>,
    /// Number of frames of an animation, written as `FILE_0001` and so on; by default one image.
    pub frames: Option<u32>,
    /// Whether the frames become one image, side by side.
    pub strip: bool,
    /// Write only the depth along the optical axis, in satellite scenes the height of what is seen, as a `.tif`.
    pub depth: bool,
    /// Write only the unit normals of discs (three bands: x, y, z of the scene's frame, which on a map are east, north, up),
    /// as a `.tif`.
    pub normals: bool,
}

/// What was rendered.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RenderSummary {
    /// The file as it was asked for; frames have a number in their name.
    pub output: PathBuf,
    /// Number of images.
    pub frames: u32,
}
