//! The kind of all splats of a training: ellipsoids (3DGS) or flat discs (2DGS).

use serde::{Deserialize, Serialize};

/// Standard deviation of a disc along its normal, as a natural logarithm of metres: so small that it has no effect.
pub const FLAT_LOG_SCALE: f32 = -30.0;

/// The kind of all splats of a training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum PrimitiveKind {
    /// Ellipsoids (3DGS).
    #[default]
    #[serde(rename = "3d")]
    Ellipsoid,
    /// Flat discs (2DGS).
    #[serde(rename = "2d")]
    Disc,
}

impl PrimitiveKind {
    /// All kinds, with the names that recipes and the command line have for them, and what they are.
    pub const NAMED: [(Self, &'static str, &'static str); 2] =
        [(Self::Ellipsoid, "3d", "Ellipsoids"), (Self::Disc, "2d", "Flat discs")];

    /// Whether this is the default kind.
    #[must_use]
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}
