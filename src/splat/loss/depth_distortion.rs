//! Depth distortion (2DGS, Huang et al. 2024, equation 13, in the squared form of the authors' program): the discs along a ray
//! lie close together.
//!
//! Of a pixel with the weights `w` and mapped depths `m` of its discs, it is the sum of `w_i w_j (m_i - m_j)²` over all pairs,
//! which is `A M2 - M1²` with the opacity `A` and the moments of the mapped depths.

use super::term::{ByView, LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::SimdReal;
use crate::splat::raster::{Image, Scaled, disc_plane};
use rayon::prelude::*;

/// Weight and column are those of mapped depths `far / (far - near) (1 - near / z)` between 0.2 and 100 (2DGS), in the unit of the
/// splats: that of [`WorkingFrame`](crate::splat::pinhole::WorkingFrame).
pub const INFO: TermInfo = TermInfo {
    weights: &["depth_distortion"],
    columns: &["depth_distortion"],
    scope: TermScope::PhotographedDiscs,
};
/// Square of the change of the mapped depth of 2DGS with the reciprocal of the depth.
const SCALE: f64 = (100.0 * 0.2 / (100.0 - 0.2)) * (100.0 * 0.2 / (100.0 - 0.2));

/// Channels of the render that the term depends on.
const CHANNELS: [usize; 3] = [disc_plane::FIRST_MOMENT, disc_plane::SECOND_MOMENT, disc_plane::TRANSMITTANCE];

/// The term; keeps its buffer between calls.
#[derive(Default)]
pub struct DepthDistortion<T> {
    by_view: Image<T>,
    factor: T,
    is_evaluated: bool,
}

impl<T: SimdReal> DepthDistortion<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

impl<T: SimdReal> LossTerm<T> for DepthDistortion<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        self.is_evaluated = rendered.discs.is_some() && weights[0] > 0.0;
        if !self.is_evaluated {
            return 0.0;
        }
        let view = rendered.view;
        let width = view.width;
        self.by_view.resize(width, view.height, CHANNELS.len());
        let rows = self.by_view.data.par_chunks_mut(CHANNELS.len() * width).enumerate();
        let sums: Vec<f64> = rows
            .map(|(row, by)| {
                let values = CHANNELS.map(|channel| view.row(channel, row));
                let mut sum = 0.0;
                for col in 0..width {
                    let [first, second, through] = values.map(|values| values[col]);
                    let opacity = T::one() - through;
                    sum += (opacity * second - first * first).as_f64();
                    by[col] = -(first + first);
                    by[width + col] = opacity;
                    by[2 * width + col] = -second;
                }
                sum
            })
            .collect();
        let per_pixel = SCALE / (width * view.height) as f64;
        self.factor = T::from_f64(weights[0] * per_pixel);
        columns[0] = sums.iter().sum::<f64>() * per_pixel;
        weights[0] * columns[0]
    }

    fn by_view(&self) -> Option<ByView<'_, T>> {
        let scaled = Scaled { image: &self.by_view, factor: self.factor };
        self.is_evaluated.then_some(ByView { scaled, channels: &CHANNELS })
    }
}
