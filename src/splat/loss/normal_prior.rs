//! Agreement with a normal prior (IndoorSplat, equation 14): the rendered normals of discs point where the prior's do.
//!
//! It is the mean of `1 - cos` with `cos = N . P / |N|` of the rendered sum of normals `N` and the prior's unit normal `P`, over
//! pixels with an opacity above one half, a normal of the prior, and `|N|` above 0.1: in the others discs disagree. The
//! derivative by `N` is `-(P - cos N / |N|) / |N|`.

use super::depth_prior::LEAST_OPACITY;
use super::term::{ByView, LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::SimdReal;
use crate::splat::raster::{Image, Scaled, channel, disc_plane};
use rayon::prelude::*;

/// The column is the mean of one minus the cosine.
pub const INFO: TermInfo =
    TermInfo { weights: &["normal_prior"], columns: &["normal_prior"], scope: TermScope::PhotographedDiscs };
/// Pixels whose sum of normals is not longer are not compared.
const LEAST_LENGTH: f64 = 0.1;
/// Channels of the render that the term has derivatives by.
const CHANNELS: [usize; 3] = [channel::NORMAL, channel::NORMAL + 1, channel::NORMAL + 2];

/// The term; keeps its buffer between calls.
#[derive(Default)]
pub struct NormalPriorAgreement<T> {
    by_view: Image<T>,
    factor: T,
    is_evaluated: bool,
}

impl<T: SimdReal> NormalPriorAgreement<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self::default()
    }
}

impl<T: SimdReal> LossTerm<T> for NormalPriorAgreement<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        columns.fill(0.0);
        self.is_evaluated = false;
        let priors = rendered.priors.filter(|_| rendered.discs.is_some() && weights[0] > 0.0);
        let Some(prior) = priors.and_then(|priors| priors.normal.as_ref()) else { return 0.0 };
        let view = rendered.view;
        let width = view.width;
        self.by_view.resize(width, view.height, CHANNELS.len());
        let rows = self.by_view.data.par_chunks_mut(CHANNELS.len() * width).enumerate();
        let sums: Vec<(f64, usize)> = rows
            .map(|(row, by)| {
                by.fill(T::zero());
                let normals = CHANNELS.map(|channel| view.row(channel, row));
                let through = view.row(disc_plane::TRANSMITTANCE, row);
                let (mut sum, mut count) = (0.0, 0);
                for col in 0..width {
                    let expected = prior.each_ref().map(|plane| f64::from(plane.data[row * width + col]));
                    let normal = normals.map(|plane| plane[col].as_f64());
                    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                    let (length, product) = (dot(normal, normal).sqrt(), dot(normal, expected));
                    let is_opaque = 1.0 - through[col].as_f64() > LEAST_OPACITY;
                    if !(is_opaque && length > LEAST_LENGTH && product.is_finite()) {
                        continue;
                    }
                    let per_length = length.recip();
                    let cosine = product * per_length;
                    (sum, count) = (sum + 1.0 - cosine, count + 1);
                    for k in 0..3 {
                        let by_normal = (cosine * normal[k] * per_length - expected[k]) * per_length;
                        by[k * width + col] = T::from_f64(by_normal);
                    }
                }
                (sum, count)
            })
            .collect();
        let (sum, count) = sums.into_iter().fold((0.0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        let per_pixel = 1.0 / count.max(1) as f64;
        self.factor = T::from_f64(weights[0] * per_pixel);
        self.is_evaluated = true;
        columns[0] = sum * per_pixel;
        weights[0] * columns[0]
    }

    fn by_view(&self) -> Option<ByView<'_, T>> {
        let scaled = Scaled { image: &self.by_view, factor: self.factor };
        self.is_evaluated.then_some(ByView { scaled, channels: &CHANNELS })
    }
}
