//! The training loss: a sum of terms.
//!
//! A term ([`LossTerm`]) compares what was rendered with something, and gives the derivatives of its part of the loss by
//! what it looked at. It has weights, which a recipe sets by name, and columns in `train.csv`. A new term is a file beside
//! [`opacity`] and a line in `loss_terms!` below.

pub mod consistency;
pub mod opacity;
pub mod photometric;
pub mod shadow_entropy;
pub mod surface_prior;
pub mod target;
mod weights;

pub use weights::{LossWeights, WeightError};

use super::raster::{Image, SortedSplats, SplatGradient};
use super::shear_warp::ShearWarp;
use super::splats::Splats;
use crate::simd::{Real, Simd, SimdReal, SimdVec};
use std::sync::Arc;
use surface_prior::Prior;

/// What is known of a term beside its values.
#[derive(Clone, Copy, Debug)]
pub struct TermInfo {
    /// Its weights in a recipe.
    pub weights: &'static [&'static str],
    /// Its columns in `train.csv`: unweighted, with the unit in the name where there is one.
    pub columns: &'static [&'static str],
}

macro_rules! loss_terms {
    ($($path:ident::$term:ident),* $(,)?) => {
        /// The terms, in the order of [`terms`].
        pub const TERMS: &[TermInfo] = &[$($path::INFO),*];

        /// The terms of a training. `prior` is the surface that splats are held to.
        #[must_use]
        pub fn terms<T: SimdReal>(prior: Option<&Arc<Prior>>) -> Vec<Box<dyn LossTerm<T>>> {
            vec![$(Box::new($path::$term::<T>::new(prior))),*]
        }
    };
}

loss_terms! {
    photometric::Photometric,
    opacity::Opacity,
    consistency::Consistency,
    shadow_entropy::ShadowEntropy,
    surface_prior::SurfacePrior,
}

/// Weights of all terms together.
pub const WEIGHTS: usize = count(false);
/// Columns of all terms together.
pub const COLUMNS: usize = count(true);

const fn count(columns: bool) -> usize {
    let (mut sum, mut k) = (0, 0);
    while k < TERMS.len() {
        sum += if columns { TERMS[k].columns.len() } else { TERMS[k].weights.len() };
        k += 1;
    }
    sum
}

/// Names of all terms' columns in `train.csv`, in their order.
pub fn column_names() -> impl Iterator<Item = &'static str> {
    TERMS.iter().flat_map(|term| term.columns.iter().copied())
}

/// What an iteration has rendered.
pub struct Rendered<'a, T> {
    /// The view's render: [`channel`](crate::splat::raster::channel)s.
    pub view: &'a Image<T>,
    /// The picture: the render as the view's image would show it, three channels.
    pub picture: &'a Image<T>,
    /// Share of sunlight, one channel; none where shadows are not modelled.
    pub sunlight: Option<&'a Image<T>>,
    /// A render of the scene by a randomly sheared camera, and where the view's pixels lie in it.
    pub virtual_view: Option<(&'a Image<T>, &'a ShearWarp<T>)>,
    /// The view's image, three channels; zero where masked.
    pub target: &'a Image<T>,
    /// The splats.
    pub splats: &'a Splats<T>,
    /// The splats in depth order.
    pub sorted: &'a SortedSplats<T>,
}

/// Derivatives that are still to be multiplied by a factor.
#[derive(Clone, Copy, Debug)]
pub struct Scaled<'a, T> {
    /// The derivatives, a channel for each channel of the image they are by.
    pub image: &'a Image<T>,
    /// The factor.
    pub factor: T,
}

impl<T: Real> Scaled<'_, T> {
    /// `sum` plus the derivatives of a row's pixels from `start` on.
    #[inline(always)]
    pub fn add_to<S: Simd<Scalar = T>>(
        &self,
        simd: S,
        sum: SimdVec<S>,
        channel: usize,
        row: usize,
        start: usize,
    ) -> SimdVec<S> {
        let factor = SimdVec::broadcast(simd, self.factor);
        factor.mul_add(SimdVec::load_from(simd, self.image.row(channel, row), start), sum)
    }
}

/// A term of the loss.
///
/// [`LossTerm::evaluate`] computes value and derivatives; the other methods then give the derivatives by what the term
/// looked at, those that it has.
pub trait LossTerm<T: Real>: Send + Sync {
    /// Evaluates the term. `weights` are those of its [`TermInfo`], `columns` are written. Gives the weighted value.
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64;

    /// Derivatives by the picture.
    fn by_picture(&self) -> Option<Scaled<'_, T>> {
        None
    }

    /// Derivatives by the share of sunlight.
    fn by_sunlight(&self) -> Option<Scaled<'_, T>> {
        None
    }

    /// Derivatives by the view's colours and altitudes.
    fn by_view(&self) -> Option<Scaled<'_, T>> {
        None
    }

    /// Derivatives by the virtual view's colours and altitudes.
    fn by_virtual_view(&self) -> Option<&Image<T>> {
        None
    }

    /// Adds derivatives by what cameras see of the splats, in depth order.
    fn add_by_sorted(&self, _sorted: &SortedSplats<T>, _by: &mut [SplatGradient<T>]) {}

    /// Adds derivatives by the splats' parameters.
    fn add_by_splats(&self, _splats: &Splats<T>, _by: &mut Splats<T>) {}
}
