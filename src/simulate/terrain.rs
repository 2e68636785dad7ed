//! What the satellites look at.

use super::plan::Relief;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The ground of a simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Terrain {
    /// A town that the seed determines.
    Town(Relief),
    /// A mountain without buildings that the seed determines: ridges, gullies, scree, snow.
    Mountains,
    /// A surface that the user has.
    Surface(SurfaceFiles),
}

/// A surface that the user has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceFiles {
    /// Heights: a north-up raster in a projected CRS in metres.
    pub surface: PathBuf,
    /// A picture of the ground in the same CRS; without it, the ground has a plain texture.
    pub texture: Option<PathBuf>,
    /// Vertical reference of the heights, as [`VerticalReference::read`](crate::io::VerticalReference::read) takes it; without
    /// it that which the file states, else the ellipsoid.
    pub vertical: Option<String>,
}

impl Terrain {
    /// Whether cars can drive there.
    pub(super) fn has_streets(&self) -> bool {
        !matches!(self, Self::Mountains)
    }

    /// Whether it is known what lies where.
    pub(super) fn has_classes(&self) -> bool {
        !matches!(self, Self::Surface(_))
    }

    /// Start of the names of the files of its truth.
    pub(super) fn truth_name(&self) -> &'static str {
        match self {
            Self::Town(_) => "TOWN",
            Self::Mountains => "MOUNTAINS",
            Self::Surface(_) => "SURFACE",
        }
    }
}

/// Starts of the names of the files of all truths.
pub(super) const TRUTH_NAMES: [&str; 3] = ["TOWN", "MOUNTAINS", "SURFACE"];
