//! The training loss: a weighted sum of terms.
//!
//! A term ([`LossTerm`]) computes its value from the renders and the splats, and its derivatives with respect to them. It has
//! weights, which a recipe sets by name, and columns in `train.csv`. A new term is a file beside
//! [`opacity`] and a line in `loss_terms!` below.

pub mod color_statistics;
pub mod consistency;
pub mod depth_distortion;
pub mod depth_prior;
pub mod light_separation;
pub mod normal_consistency;
pub mod normal_prior;
pub mod opacity;
pub mod perceptual;
pub mod photometric;
mod prior;
mod prior_targets;
pub mod shadow_entropy;
pub mod surface_prior;
pub mod target;
mod term;
mod term_set;
mod terms;
mod weights;

pub use prior::{Prior, PriorCells};
pub use prior_targets::PriorTargets;
pub use term::{ByView, DiscView, LossTerm, Rendered, SurfaceDepth, TermInfo, TermScope};
pub use term_set::{Losses, Parts, TermSet};
pub use terms::TermInputs;
pub use weights::{LossWeights, WeightError};

use crate::simd::SimdReal;

macro_rules! loss_terms {
    ($($path:ident::$term:ident),* $(,)?) => {
        /// Names of the terms' weights and columns, in the order of [`terms`].
        pub const TERMS: &[TermInfo] = &[$($path::INFO),*];

        /// All loss terms.
        #[must_use]
        pub fn terms<T: SimdReal>(mut inputs: TermInputs<T>) -> TermSet<T> {
            TermSet::new(vec![$(Box::new($path::$term::<T>::new(&mut inputs))),*])
        }
    };
}

loss_terms! {
    photometric::Photometric,
    opacity::Opacity,
    consistency::Consistency,
    shadow_entropy::ShadowEntropy,
    surface_prior::SurfacePrior,
    normal_consistency::NormalConsistency,
    depth_distortion::DepthDistortion,
    depth_prior::DepthPriorAgreement,
    normal_prior::NormalPriorAgreement,
    light_separation::LightSeparation,
    perceptual::Perceptual,
    color_statistics::ColorStatistics,
}

/// Number of weights of all terms.
pub const WEIGHTS: usize = count(false);
/// Number of columns of all terms.
pub const COLUMNS: usize = count(true);

const fn count(columns: bool) -> usize {
    let (mut sum, mut k) = (0, 0);
    while k < TERMS.len() {
        sum += if columns { TERMS[k].columns.len() } else { TERMS[k].weights.len() };
        k += 1;
    }
    sum
}

/// Names of the columns of all terms in `train.csv`, in their order.
pub fn column_names() -> impl Iterator<Item = &'static str> {
    TERMS.iter().flat_map(|term| term.columns.iter().copied())
}
