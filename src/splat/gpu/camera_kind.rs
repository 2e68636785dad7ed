//! The kinds of cameras that kernels are compiled for.

/// The kind of a camera, which decides how splats are ordered and what is composited of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraKind {
    /// A pinhole camera: by depth, and the colour as displayed.
    Pinhole,
    /// An affine camera with a quadratic term: by altitude, and linear colour and altitude.
    Parallel,
}

impl CameraKind {
    /// Number of features that are composited: `FEATURES` in `wgsl/color.wgsl` and `wgsl/color_altitude.wgsl`.
    pub fn features(self) -> u64 {
        match self {
            Self::Pinhole => 3,
            Self::Parallel => 4,
        }
    }

    /// Words in the slot of a pair of a splat and a tile: `SLOT` there.
    pub fn slot_words(self) -> u64 {
        6 + self.features()
    }
}
