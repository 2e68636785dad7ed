//! What transparent pixels of photographs mean.

use super::scene_parts::Layout;
use serde::{Deserialize, Serialize};

/// What transparent pixels of photographs mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Transparency {
    /// Nothing is there: the background shows, by the part of a pixel that is transparent (instant-ngp, nerfstudio, Blender).
    Empty,
    /// Nothing is known of the pixel: it is not compared, as where a mask is black. A pixel counts as transparent if more than
    /// half of it is.
    Unknown,
}

impl Transparency {
    /// The names of the meanings.
    pub const NAMES: [&str; 2] = ["empty", "unknown"];

    /// The meaning of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        [Self::Empty, Self::Unknown].into_iter().zip(Self::NAMES).find(|(_, n)| *n == name).map(|(m, _)| m)
    }

    /// The meaning in scenes of a layout, as the programs have it that read them.
    #[must_use]
    pub fn of(layout: Layout) -> Self {
        if layout == Layout::Transforms { Self::Empty } else { Self::Unknown }
    }

    /// What it means, for messages.
    #[must_use]
    pub fn meaning(self) -> &'static str {
        match self {
            Self::Empty => "empty: nothing is there (--transparent unknown leaves them out)",
            Self::Unknown => {
                "left out: nothing is known there (--transparent empty takes them for background)"
            }
        }
    }
}
