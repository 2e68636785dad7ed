//! What the satellites look at.

use super::plan::Relief;
use serde::{Deserialize, Serialize};

/// The ground of a simulation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Terrain {
    /// A town that the seed determines.
    Town(Relief),
    /// A mountain without buildings that the seed determines: ridges, gullies, scree, snow.
    Mountains,
}

impl Terrain {
    /// Whether cars can drive there.
    pub(super) fn has_streets(&self) -> bool {
        !matches!(self, Self::Mountains)
    }

    /// Start of the names of the files of its truth.
    pub(super) fn truth_name(&self) -> &'static str {
        match self {
            Self::Town(_) => "TOWN",
            Self::Mountains => "MOUNTAINS",
        }
    }
}

/// Starts of the names of the files of all truths.
pub(super) const TRUTH_NAMES: [&str; 2] = ["TOWN", "MOUNTAINS"];
