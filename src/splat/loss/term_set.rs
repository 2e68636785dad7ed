//! The terms of the loss together: their sum, and the sums of their derivatives.

use super::term::{ByView, LossTerm, Rendered};
use super::{COLUMNS, LossWeights, TERMS, column_names};
use crate::simd::{Simd, SimdKernel, SimdReal, SimdVec};
use crate::splat::appearance::SplatLight;
use crate::splat::raster::{Image, Scaled};
use crate::splat::splats::Splats;
use crate::splat::stopwatch::Stopwatch;
use rayon::prelude::*;
use std::ops::Deref;

/// The loss of an iteration.
#[derive(Clone, Copy, Debug, Default)]
pub struct Losses {
    /// The weighted sum of all terms.
    pub total: f64,
    /// The unweighted columns of the terms, named by [`column_names`].
    pub columns: [f64; COLUMNS],
}

impl Losses {
    /// [`Losses::average_over`] the pixels with data; all have if there is no list of them.
    fn average_valid(&mut self, valid: &[bool]) {
        let count = valid.iter().filter(|is_valid| **is_valid).count();
        if count < valid.len() {
            self.average_over(count as f64 / valid.len() as f64);
        }
    }

    /// Makes the columns that are means over all pixels means over this share of them, as pixels without data are zero in both images,
    /// where L1 is 0 and SSIM 1. NaN if no pixel has data. The total stays.
    pub fn average_over(&mut self, share: f64) {
        for (value, name) in self.columns.iter_mut().zip(column_names()) {
            match name {
                "l1" => *value /= share,
                "ssim" => *value = (*value - (1.0 - share)) / share,
                _ => {}
            }
        }
    }
}

/// All terms of the loss, in the order of [`TERMS`]; none where pictures are rendered only.
///
/// [`TermSet::evaluate`] computes the loss and all derivatives; the other methods then return those.
#[derive(Default)]
pub struct TermSet<T>(Vec<Box<dyn LossTerm<T>>>);

impl<T: SimdReal> TermSet<T> {
    pub(super) fn new(terms: Vec<Box<dyn LossTerm<T>>>) -> Self {
        Self(terms)
    }

    /// Computes the loss of what was rendered; adds the time of each term to `watch`. `valid` tells which pixels have data, row by
    /// row; it is empty if all have.
    pub fn evaluate(
        &mut self,
        rendered: &Rendered<T>,
        weights: &LossWeights,
        valid: &[bool],
        watch: &mut Stopwatch,
    ) -> Losses {
        let mut losses = Losses::default();
        let mut columns = &mut losses.columns[..];
        for ((term, info), weights) in self.0.iter_mut().zip(TERMS).zip(weights.by_term()) {
            let (own, others) = columns.split_at_mut(info.columns.len());
            losses.total += term.evaluate(rendered, weights, own);
            columns = others;
            watch.lap("loss", info.columns[0]);
        }
        losses.average_valid(valid);
        losses
    }

    /// The derivatives by the picture.
    #[must_use]
    pub fn by_picture(&self) -> Parts<'_, T> {
        self.parts(None, |term| term.by_picture())
    }

    /// The derivatives by the share of sunlight, and `own`, which the colour model computes.
    #[must_use]
    pub fn by_sunlight<'a>(&'a self, own: Scaled<'a, T>) -> Parts<'a, T> {
        self.parts(Some(own), |term| term.by_sunlight())
    }

    /// The derivatives by the same image, after `own`.
    fn parts<'a>(
        &'a self,
        own: Option<Scaled<'a, T>>,
        of: impl Fn(&'a dyn LossTerm<T>) -> Option<Scaled<'a, T>>,
    ) -> Parts<'a, T> {
        let mut out = Parts { parts: [None; TERMS.len() + 1], count: 0 };
        for part in own.into_iter().chain(self.0.iter().filter_map(|term| of(term.as_ref()))) {
            out.parts[out.count] = Some(part);
            out.count += 1;
        }
        out
    }

    /// Adds the derivatives by the view's render to `sum`, each of whose rows `begin` prepares, given its number.
    pub fn add_by_view(&self, sum: &mut Image<T>, begin: impl Fn(usize, &mut [T]) + Sync) {
        let mut parts = [None; TERMS.len()];
        for (part, term) in parts.iter_mut().zip(&self.0) {
            *part = term.by_view();
        }
        let Image { width, channels, .. } = *sum;
        let rows = sum.data.par_chunks_mut(channels * width).with_min_len(16);
        rows.enumerate().for_each(|(row, sum)| {
            begin(row, sum);
            for ByView { scaled: Scaled { image, factor }, channels } in parts.iter().flatten() {
                for (k, channel) in channels.iter().enumerate() {
                    let (sum, by) = (&mut sum[channel * width..][..width], image.row(k, row));
                    T::dispatch(AddScaled { sum, by, factor: *factor });
                }
            }
        });
    }

    /// The derivatives by the virtual view's render: colours and altitudes.
    pub fn by_virtual_view(&self) -> impl Iterator<Item = &Image<T>> {
        self.0.iter().filter_map(|term| term.by_virtual_view())
    }

    /// The derivatives by light and colours of the splats.
    #[must_use]
    pub fn by_light(&self) -> Option<&SplatLight<T>> {
        self.0.iter().find_map(|term| term.by_light())
    }

    /// The derivative by the opacity of each splat, shown or not.
    #[must_use]
    pub fn by_opacity(&self) -> T {
        self.0.iter().map(|term| term.by_opacity()).sum()
    }

    /// Adds the derivatives by the splats' parameters.
    pub fn add_by_splats(&self, splats: &Splats<T>, by: &mut Splats<T>) {
        self.0.iter().for_each(|term| term.add_by_splats(splats, by));
    }
}

/// Derivatives by one image, to be added up.
pub struct Parts<'a, T> {
    parts: [Option<Scaled<'a, T>>; TERMS.len() + 1],
    count: usize,
}

/// As a slice it holds only those that there are, because kernels go through it in every vector of pixels.
impl<'a, T> Deref for Parts<'a, T> {
    type Target = [Option<Scaled<'a, T>>];

    fn deref(&self) -> &Self::Target {
        &self.parts[..self.count]
    }
}

/// `sum += factor * by`.
struct AddScaled<'a, T> {
    sum: &'a mut [T],
    by: &'a [T],
    factor: T,
}

impl<T: SimdReal> SimdKernel<T> for AddScaled<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let factor = SimdVec::broadcast(simd, self.factor);
        for start in (0..self.sum.len()).step_by(S::WIDTH) {
            let sum = SimdVec::load_from(simd, self.sum, start);
            factor.mul_add(SimdVec::load_from(simd, self.by, start), sum).store_to(self.sum, start);
        }
    }
}
