//! The parts of a perspective scene that all layouts share.

use crate::frame::{Point, Site};
use serde::{Deserialize, Serialize};

/// How the files of a perspective scene are arranged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// A COLMAP project: a binary or text model and its images.
    Colmap,
    /// A `transforms.json` of instant-ngp or nerfstudio.
    Transforms,
    /// Frames with depth maps in the form of 7-Scenes.
    RgbD,
    /// A scene of LEVIR-NVS.
    Levir,
    /// The photographs of a scene of ScanNet++.
    #[serde(rename = "scannet++")]
    ScanNetPp,
}

impl Layout {
    /// Whether depth maps of such scenes are a reference to compare with, rendered from a model, and not measured with the images.
    #[must_use]
    pub fn has_reference_depths(self) -> bool {
        matches!(self, Self::Levir | Self::ScanNetPp)
    }

    /// What users call it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "COLMAP model",
            Self::Transforms => "transforms.json",
            Self::RgbD => "RGB-D frames",
            Self::Levir => "LEVIR-NVS",
            Self::ScanNetPp => "ScanNet++",
        }
    }
}

/// A point of a perspective scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScenePoint {
    /// Its position.
    pub position: Point<Site>,
    /// Red, green, blue.
    pub rgb: [u8; 3],
}
