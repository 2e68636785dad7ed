//! The kinds of renders that kernels are compiled for.

use crate::splat::primitive::PrimitiveKind;

/// The kind of a render: its camera, which decides how splats are ordered, and the kind of its splats, which decides what is
/// composited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderKind {
    /// Ellipsoids and a pinhole camera: by depth, and the colour as displayed.
    Pinhole,
    /// Flat discs and a pinhole camera: by depth, and the colour as displayed, the depth and the normal.
    PinholeDiscs,
    /// Ellipsoids and an affine camera with a quadratic term: by altitude, and linear colour and altitude.
    Parallel,
}

impl RenderKind {
    /// Of photographs with splats of this kind.
    pub fn of_photographs(primitive: PrimitiveKind) -> Self {
        match primitive {
            PrimitiveKind::Ellipsoid => Self::Pinhole,
            PrimitiveKind::Disc => Self::PinholeDiscs,
        }
    }

    /// Number of planes by which the loss has derivatives: `PLANES` in `wgsl/color.wgsl` and the files beside it.
    pub fn planes(self) -> u64 {
        match self {
            Self::Pinhole => 3,
            Self::PinholeDiscs => 8,
            Self::Parallel => 4,
        }
    }

    /// Words of a pixel: four times `PIXEL` there.
    pub fn pixel_words(self) -> u64 {
        match self {
            Self::Pinhole | Self::Parallel => 4,
            Self::PinholeDiscs => 8,
        }
    }

    /// Words in the slot of a pair of a splat and a tile: `SLOT` there.
    pub fn slot_words(self) -> u64 {
        match self {
            Self::Pinhole => 9,
            Self::PinholeDiscs => 17,
            Self::Parallel => 10,
        }
    }

    /// Words of the plane of a splat: `Plane` in `wgsl/color_surface.wgsl`; none of ellipsoids.
    pub fn plane_words(self) -> Option<u64> {
        (self == Self::PinholeDiscs).then_some(12)
    }
}
