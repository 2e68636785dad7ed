//! Colour models: how a view shows the splats' colours.
//!
//! A model has two hooks. It gives every splat the colour that is rendered ([`AppearanceModel::splat_colors`]), and makes of
//! rendered colours and sunlight the picture that is compared with the view's image ([`AppearanceModel::shade`]).
//! A new model is a file beside [`affine`], and a line in [`AppearanceKind`] and in [`AppearanceKind::model`].

pub mod affine;

use crate::simd::{Real, SimdReal};
use crate::splat::loss::Scaled;
use crate::splat::raster::Image;
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_gradient};
use affine::AffineAppearance;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The colour models there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AppearanceKind {
    /// An affine map of colours and an ambient share of light for each view (EOGS): [`affine`].
    #[default]
    Affine,
}

impl AppearanceKind {
    /// The model.
    #[must_use]
    pub fn model<T: SimdReal>(self) -> Box<dyn AppearanceModel<T>> {
        match self {
            Self::Affine => Box::<AffineAppearance<T>>::default(),
        }
    }
}

/// The parameters of a view in a colour model.
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

    /// What makes of a linear colour the one that the view shows in full sunlight.
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

/// What a picture is made of.
#[derive(Clone, Copy)]
pub struct ShadingInput<'a, T> {
    /// The view's render: [`channel`](crate::splat::raster::channel) colours and altitude.
    pub render: &'a Image<T>,
    /// Share of sunlight, one channel.
    pub sunlight: &'a Image<T>,
    /// Pixels that count, row by row; empty when all do. Others are black in the picture.
    pub valid: &'a [bool],
}

/// Where a model puts derivatives.
pub struct ShadingGradient<'a, T> {
    /// By the render: the model writes the colour channels.
    pub by_render: &'a mut Image<T>,
    /// By the share of sunlight, one channel.
    pub by_sunlight: &'a mut Image<T>,
    /// By the view's parameters.
    pub by_values: &'a mut [T],
}

/// A colour model; `values` are a view's parameters.
pub trait AppearanceModel<T: Real>: Send + Sync {
    /// Parameters of a view at the start of training.
    fn start(&self) -> Vec<T>;

    /// The colours of all splats for a view, which are rendered.
    fn splat_colors(&mut self, _values: &[T], splats: &Splats<T>, colors: &mut Vec<[T; 3]>) {
        colors.resize(splats.len(), [T::zero(); 3]);
        let rows = colors.par_iter_mut().zip(&splats.f_dc).with_min_len(1024);
        rows.for_each(|(color, f_dc)| *color = color_from_f_dc(*f_dc));
    }

    /// From derivatives by the colours of [`AppearanceModel::splat_colors`] to those by the splats' parameters, which are
    /// written, and by the view's, which are added to.
    fn splat_colors_backward(
        &mut self,
        _values: &[T],
        _splats: &Splats<T>,
        by_colors: &[[T; 3]],
        by_splats: &mut Splats<T>,
        _by_values: &mut [T],
    ) {
        let rows = by_splats.f_dc.par_iter_mut().zip(by_colors).with_min_len(1024);
        rows.for_each(|(f_dc, by)| *f_dc = f_dc_gradient(*by));
    }

    /// Makes the picture, three channels.
    fn shade(&mut self, values: &[T], input: ShadingInput<T>, picture: &mut Image<T>);

    /// From derivatives by the picture to those by its input and by the view's parameters, all of which are written.
    fn shade_backward(
        &mut self,
        values: &[T],
        input: ShadingInput<T>,
        by_picture: &[Option<Scaled<T>>],
        gradient: ShadingGradient<T>,
    );

    /// A linear colour as the view shows it in full sunlight.
    fn sunlit(&self, values: &[T], rgb: [T; 3]) -> [T; 3];
}
