//! The interface of a colour model.

use super::light::SplatLight;
use crate::simd::Real;
use crate::splat::raster::{Image, Scaled};
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_gradient};
use rayon::prelude::*;

/// The input of [`AppearanceModel::shade`].
#[derive(Clone, Copy)]
pub struct ShadingInput<'a, T> {
    /// The view's render: linear colour, altitude and transmittance ([`channel`](crate::splat::raster::channel)).
    pub render: &'a Image<T>,
    /// Share of sunlight, 0 to 1, one channel.
    pub sunlight: &'a Image<T>,
    /// Which pixels are valid, row by row; empty if all are. The others are zero in the picture.
    pub valid: &'a [bool],
}

/// The output of [`AppearanceModel::shade_backward`].
pub struct ShadingGradient<'a, T> {
    /// Derivatives with respect to the render; the model writes the colour channels.
    pub by_render: &'a mut Image<T>,
    /// Derivatives with respect to the share of sunlight, one channel.
    pub by_sunlight: &'a mut Image<T>,
    /// Derivatives with respect to the view's parameters.
    pub by_values: &'a mut [T],
}

/// The parameters of a colour model.
#[derive(Clone, Copy, Debug)]
pub struct ModelParameters<'a, T> {
    /// Those that all views share; most models have none.
    pub shared: &'a [T],
    /// Those of the view.
    pub view: &'a [T],
}

/// Derivatives by the parameters of a colour model.
#[derive(Debug)]
pub struct ParameterGradient<'a, T> {
    /// By those that all views share.
    pub shared: &'a mut [T],
    /// By those of the view.
    pub view: &'a mut [T],
}

/// What the colours of splats follow from.
#[derive(Clone, Copy)]
pub struct ColorInput<'a, T> {
    /// The model's parameters.
    pub parameters: ModelParameters<'a, T>,
    /// The splats.
    pub splats: &'a Splats<T>,
    /// The sun; none if it is unknown.
    pub sun: Option<SplatSun<'a, T>>,
}

/// The sun as the splats see it.
#[derive(Clone, Copy, Debug)]
pub struct SplatSun<'a, T> {
    /// Unit vector to the sun in site axes.
    pub direction: [T; 3],
    /// Visibility of the sun from each splat, 0 to 1 ([`sun_visibility`](crate::splat::sun_visibility)).
    pub visibility: &'a [T],
}

/// A colour model. `values` are the parameters of a view.
pub trait AppearanceModel<T: Real>: Send + Sync {
    /// The parameters that all views share, at the start of training; those of networks are random. Most models have none.
    fn start_shared(&self, _seed: u64) -> Vec<T> {
        Vec::new()
    }

    /// The parameters of a view at the start of training; those of networks are random.
    fn start_view(&self, seed: u64, view: u64) -> Vec<T>;

    /// The linear colour of a view in full sunlight for a linear splat colour; the identity for models that colour each splat on its
    /// own.
    fn sunlit(&self, _values: &[T], rgb: [T; 3]) -> [T; 3] {
        rgb
    }

    /// Whether the colours of splats depend on the visibility of the sun from each. If not, the picture depends on the share
    /// of sunlight of each pixel, which [`ShadowModel`](crate::splat::shadow::ShadowModel) computes.
    fn has_shaded_splats(&self) -> bool {
        false
    }

    /// Computes the colours of all splats that are rendered for a view.
    fn splat_colors(&mut self, input: ColorInput<T>, colors: &mut Vec<[T; 3]>) {
        colors.resize(input.splats.len(), [T::zero(); 3]);
        let rows = colors.par_iter_mut().zip(&input.splats.f_dc).with_min_len(1024);
        rows.for_each(|(color, f_dc)| *color = color_from_f_dc(*f_dc));
    }

    /// Light and colours apart, as the last [`AppearanceModel::splat_colors`] computed them; none if the model does not
    /// separate them or the sun is unknown.
    fn light(&self) -> Option<&SplatLight<T>> {
        None
    }

    /// The gradient of [`AppearanceModel::splat_colors`]: writes the derivatives with respect to the splats' parameters and
    /// adds those with respect to the model's parameters. `by_light` holds further derivatives by [`AppearanceModel::light`].
    fn splat_colors_backward(
        &mut self,
        _input: ColorInput<T>,
        by_colors: &[[T; 3]],
        _by_light: Option<&SplatLight<T>>,
        by_splats: &mut Splats<T>,
        _by_parameters: ParameterGradient<T>,
    ) {
        let rows = by_splats.f_dc.par_iter_mut().zip(by_colors).with_min_len(1024);
        rows.for_each(|(f_dc, by)| *f_dc = f_dc_gradient(*by));
    }

    /// Computes the picture: linear colours, three channels.
    fn shade(&mut self, values: &[T], input: ShadingInput<T>, picture: &mut Image<T>);

    /// The gradient of [`AppearanceModel::shade`]: writes all derivatives of `gradient`, from the sum of the derivatives
    /// `by_picture`.
    fn shade_backward(
        &mut self,
        values: &[T],
        input: ShadingInput<T>,
        by_picture: &[Option<Scaled<T>>],
        gradient: ShadingGradient<T>,
    );
}
