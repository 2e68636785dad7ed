//! The interface of a colour model.

use crate::simd::Real;
use crate::splat::loss::Scaled;
use crate::splat::raster::Image;
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

/// A colour model. `values` are the parameters of a view.
pub trait AppearanceModel<T: Real>: Send + Sync {
    /// Parameters of a view at the start of training.
    fn start(&self) -> Vec<T>;

    /// Computes the linear colours of all splats that are rendered for a view.
    fn splat_colors(&mut self, _values: &[T], splats: &Splats<T>, colors: &mut Vec<[T; 3]>) {
        colors.resize(splats.len(), [T::zero(); 3]);
        let rows = colors.par_iter_mut().zip(&splats.f_dc).with_min_len(1024);
        rows.for_each(|(color, f_dc)| *color = color_from_f_dc(*f_dc));
    }

    /// The gradient of [`AppearanceModel::splat_colors`]: writes the derivatives with respect to the splats' parameters and
    /// adds those with respect to the view's parameters.
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

    /// The linear colour of the view in full sunlight for a linear splat colour.
    fn sunlit(&self, values: &[T], rgb: [T; 3]) -> [T; 3];
}
