//! How a perspective scene is read.

use super::transparency::Transparency;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Every how-manieth image is held back for tests by default, as in Mip-NeRF 360 and 3DGS.
pub const TEST_EVERY: usize = 8;

/// Which views are held back for tests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum TestViews {
    /// The first view and every n-th after it, in the order of the image names. A scene that comes with a list of its
    /// own (LEVIR-NVS, ScanNet++) keeps that.
    Every(usize),
    /// The views whose image names are listed in a text file, one a line, with or without the extension.
    List(PathBuf),
    /// No view.
    None,
}

/// Where the georeference of a scene comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum GeoreferenceSource {
    /// The positions that the photographs state (GPS in their EXIF).
    Exif,
    /// A file: JSON with an EPSG code and a similarity, or a list of image positions.
    File(PathBuf),
}

/// How a perspective scene is read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PerspectiveOptions {
    /// Which views are held back for tests.
    pub test_views: TestViews,
    /// Where the scene lies on Earth; without one it keeps the frame of its file.
    pub georeference: Option<GeoreferenceSource>,
    /// Images are read with 1/n of their columns and rows: 1, 2, 4 or 8.
    pub downsampling: u32,
    /// What transparent pixels mean; by default what the programs of the scene's layout take them for.
    #[serde(default)]
    pub transparency: Option<Transparency>,
}

impl Default for PerspectiveOptions {
    fn default() -> Self {
        Self {
            test_views: TestViews::Every(TEST_EVERY),
            georeference: None,
            downsampling: 1,
            transparency: None,
        }
    }
}
