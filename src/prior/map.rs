//! Depths and normals of a view, from a network, a sensor or matching.

use crate::io::Grid2;

/// The colour of a pixel (column, row) of a view, red, green, blue; none where an image has no data.
pub type PixelColor<'a> = Box<dyn Fn(usize, usize) -> Option<[u8; 3]> + Sync + 'a>;

/// What the values of a depth prior are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DepthKind {
    /// Depths along the optical axis, in the unit of the scene.
    Metric,
    /// Depths up to an unknown scale and shift; larger is farther.
    Relative,
    /// Inverse depths up to an unknown scale and shift; larger is nearer.
    Disparity,
    /// Depths along the optical axis from a sensor or from matching, in the unit of the scene: used without correction.
    Measured,
    /// Depths along the optical axis that were brought to the points of the scene and to other views.
    #[serde(skip)]
    Aligned,
}

impl DepthKind {
    /// The kinds that users state, with their names and what they are.
    pub const STATED: [(Self, &'static str, &'static str); 4] = [
        (
            Self::Metric,
            "metric",
            "Depths in the unit of the scene, of a network: their scale and shift are corrected",
        ),
        (Self::Measured, "measured", "Depths in the unit of the scene, of a sensor: used without correction"),
        (Self::Relative, "relative", "Depths with unknown scale and shift: larger is farther"),
        (Self::Disparity, "disparity", "Inverse depths with unknown scale and shift: larger is nearer"),
    ];

    /// What values of this kind are compared with: a depth, or its inverse.
    #[must_use]
    pub fn of_depth(self, depth: f64) -> f64 {
        if self == Self::Disparity { depth.recip() } else { depth }
    }

    /// Whether values are depths in the frame of the scene, which need no fit.
    #[must_use]
    pub fn is_absolute(self) -> bool {
        matches!(self, Self::Measured | Self::Aligned)
    }
}

impl std::fmt::Display for DepthKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Metric => "metric",
            Self::Relative => "relative",
            Self::Disparity => "disparity",
            Self::Measured => "measured",
            Self::Aligned => "aligned",
        })
    }
}

/// What a prior says of each pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PriorContent {
    /// How far away the surface is.
    Depths,
    /// Where the surface faces.
    Normals,
}

impl std::fmt::Display for PriorContent {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Depths => "depths",
            Self::Normals => "normals",
        })
    }
}

/// A value for each pixel of a view that says how far away the surface is.
#[derive(Clone, Debug)]
pub struct DepthPrior {
    /// The values, of the size of the view's undistorted image; NaN where nothing is known.
    pub values: Grid2,
    /// What the values are.
    pub kind: DepthKind,
}

impl DepthPrior {
    /// The same depth everywhere, which alignment with points makes one that is interpolated between them.
    #[must_use]
    pub fn level((width, height): (usize, usize)) -> Self {
        Self { values: Grid2::filled(width, height, 1.0), kind: DepthKind::Relative }
    }
}

/// A normal for each pixel of a view.
#[derive(Clone, Debug)]
pub struct NormalPrior {
    /// The components of unit vectors that face the camera, in its axes (right, down, forward), of the size of the view's
    /// undistorted image; NaN where nothing is known.
    pub planes: [Grid2; 3],
}

/// The priors of a view, each if there is one.
#[derive(Clone, Debug, Default)]
pub struct ViewPriors {
    /// Depths.
    pub depth: Option<DepthPrior>,
    /// Normals.
    pub normal: Option<NormalPrior>,
}
