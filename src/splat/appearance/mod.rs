//! Colour models: how the colours of a view's image follow from the colours of the splats.
//!
//! A model has two parts. [`AppearanceModel::splat_colors`] computes the colour of each splat that is rendered.
//! [`AppearanceModel::shade`] computes the picture, which is compared with the view's image, from the rendered colours and
//! the share of sunlight. Each view has its own parameters, and a model may have more, which all views share. A new model is
//! a file beside [`affine`], and a line in [`AppearanceKind`] and in [`AppearanceKind::model`].

pub mod affine;
mod light;
mod model;
pub mod satgs;

pub use light::SplatLight;
pub use model::{
    AppearanceModel, ColorInput, ModelParameters, ParameterGradient, ShadingGradient, ShadingInput, SplatSun,
};

use crate::simd::SimdReal;
use affine::AffineAppearance;
use satgs::{Cube, Networks, SatGs};
use serde::{Deserialize, Serialize};

/// The available colour models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AppearanceKind {
    /// An affine map of linear colours and an ambient light colour for each view (EOGS): [`affine`].
    #[default]
    Affine,
    /// Networks that tone and shade each splat for each view (SatGS): [`satgs`]. Colours are those that images show.
    SatGs,
}

impl AppearanceKind {
    /// An instance of the model for a scene within a cube, with its buffers.
    #[must_use]
    pub fn model<T: SimdReal>(self, cube: Cube) -> Box<dyn AppearanceModel<T>> {
        match self {
            Self::Affine => Box::<AffineAppearance<T>>::default(),
            Self::SatGs => Box::new(SatGs::new(Networks::default(), cube)),
        }
    }

    /// Initial parameters that all views share.
    #[must_use]
    pub fn start_shared<T: SimdReal>(self, seed: u64) -> Vec<T> {
        self.model::<T>(Cube::default()).start_shared(seed)
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
    /// The parameters of a view at the start of training; those of networks are random.
    #[must_use]
    pub fn start(kind: AppearanceKind, seed: u64, view: u64) -> Self {
        Self { kind, values: kind.model::<T>(Cube::default()).start_view(seed, view) }
    }

    /// Whether there are as many values as the model has parameters.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.values.len() == Self::start(self.kind, 0, 0).values.len()
    }

    /// The map from a linear splat colour to the linear colour of the view in full sunlight; the identity for models that
    /// colour each splat on its own.
    pub fn sunlit(&self) -> impl Fn([T; 3]) -> [T; 3] + '_ {
        let model = self.kind.model::<T>(Cube::default());
        move |rgb| model.sunlit(&self.values, rgb)
    }
}

impl Default for Appearance {
    /// The default model at the start of training.
    fn default() -> Self {
        Self::start(AppearanceKind::default(), 0, 0)
    }
}
