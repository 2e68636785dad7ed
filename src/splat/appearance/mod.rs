//! Colour models: how the colours of a view's image follow from the colours of the splats.
//!
//! A model has two parts. [`AppearanceModel::splat_colors`] computes the colour of each splat that is rendered.
//! [`AppearanceModel::shade`] computes the picture, which is compared with the view's image, from the rendered colours and
//! the share of sunlight. Each view has its own parameters. All colours are linear. A new model is a file beside [`affine`], and a line in [`AppearanceKind`] and in [`AppearanceKind::model`].

pub mod affine;
mod model;

pub use model::{AppearanceModel, ShadingGradient, ShadingInput};

use crate::simd::SimdReal;
use affine::AffineAppearance;
use serde::{Deserialize, Serialize};

/// The available colour models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AppearanceKind {
    /// An affine map of colours and an ambient light colour for each view (EOGS): [`affine`].
    #[default]
    Affine,
}

impl AppearanceKind {
    /// An instance of the model, with its buffers.
    #[must_use]
    pub fn model<T: SimdReal>(self) -> Box<dyn AppearanceModel<T>> {
        match self {
            Self::Affine => Box::<AffineAppearance<T>>::default(),
        }
    }
}

/// The colour model of one view with its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Appearance<T = f32> {
    /// The model.
    #[serde(default)]
    pub kind: AppearanceKind,
    /// Its parameters.
    pub values: Vec<T>,
}

impl<T: SimdReal> Appearance<T> {
    /// The parameters at the start of training.
    #[must_use]
    pub fn start(kind: AppearanceKind) -> Self {
        Self { kind, values: kind.model::<T>().start() }
    }

    /// The map from a linear splat colour to the linear colour of the view in full sunlight.
    pub fn sunlit(&self) -> impl Fn([T; 3]) -> [T; 3] + '_ {
        let model = self.kind.model::<T>();
        move |rgb| model.sunlit(&self.values, rgb)
    }
}

impl Default for Appearance {
    /// The default model at the start of training.
    fn default() -> Self {
        Self::start(AppearanceKind::default())
    }
}
