//! Visibility of the pixels of training views: low where an image shows what the others do not (SatGS, equations 14 to 17).
//!
//! After an iteration, features of the view's image and of its picture are compared, patch by patch, and their running mean
//! difference gives the visibility in the view's next iterations: in closed form, or by a head that sees the features of the
//! image. No derivative of this goes to the splats.

use crate::fault::ErrorKind;
use crate::io::Grid2;
use crate::nn::adam::{Adam, AdamRule};
use crate::nn::features::{DenseFeatures, FeatureError, FeatureMap};
use crate::nn::uncertainty::{
    HeadState, SCALE, UncertaintyError, UncertaintyHead, UncertaintyLoss, dissimilarity, upsample,
    visibility_of_sigma,
};
use crate::splat::raster::Image;
use serde::{Deserialize, Serialize};

/// Weight of the newest difference in the running mean.
const NEWEST: f32 = 0.1;
/// Learning rate of the head (SatGS, §4.1.2).
const HEAD_RATE: f64 = 1e-3;

/// What the uncertainty of pixels follows from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum UncertaintyModel {
    /// The difference of features in a patch alone.
    Closed,
    /// A head that sees the features of the image (SatGS).
    Head,
}

/// How pixels that other images do not confirm are left out of the photometric loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UncertaintyRecipe {
    /// What the uncertainty follows from.
    pub model: UncertaintyModel,
    /// First iteration in which images and pictures are compared.
    pub from: u32,
    /// First iteration in which visibility counts fully; it counts more and more from the first one on.
    pub full_from: u32,
    /// Weight of the logarithm of the uncertainty in its loss.
    pub prior: f64,
    /// Weight of the visibility of all pixels in that loss (SatGS: 1). The smaller, the lower the visibility of what differs.
    pub visible: f64,
}

impl UncertaintyRecipe {
    /// The share, 0 to 1, to which visibility counts in an iteration; none before images and pictures are compared.
    #[must_use]
    pub fn share(&self, iteration: u32) -> Option<f64> {
        let span = f64::from(self.full_from.saturating_sub(self.from).max(1));
        let since = iteration.checked_sub(self.from)?;
        Some((f64::from(since) / span).min(1.0))
    }

    fn loss(&self) -> UncertaintyLoss {
        UncertaintyLoss { prior: self.prior, visible: self.visible }
    }
}

/// What is known about the visibility, as checkpoints store it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct VisibilityState {
    /// Running mean of the difference of features in each patch of each view; none before the first comparison.
    differences: Vec<Option<Grid2>>,
    /// The head, if there is one, and the moments of its gradient.
    head: Option<(HeadState<f32>, Adam)>,
}

/// The visibility of a view's patches.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchVisibility {
    /// Columns and rows of a patch, pixels.
    pub patch_px: usize,
    /// The visibility of each patch, 0 to 1.
    pub patches: Grid2,
}

impl PatchVisibility {
    /// The visibility of the pixels of an image of this size (columns, rows).
    #[must_use]
    pub fn at_pixels(&self, (width, height): (usize, usize)) -> Grid2 {
        upsample(&self.patches, self.patch_px, width, height)
    }
}

/// Why visibility cannot be computed.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum VisibilityError {
    /// See [`FeatureError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Feature(#[from] FeatureError),
    /// See [`UncertaintyError`].
    #[error(transparent)]
    #[diagnostic(transparent)]
    Uncertainty(#[from] UncertaintyError),
}

impl VisibilityError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Feature(e) => e.kind(),
            Self::Uncertainty(UncertaintyError::Channels { .. }) => ErrorKind::Input,
            Self::Uncertainty(_) => ErrorKind::Failed,
        }
    }
}

/// Compares views with their pictures.
pub struct VisibilityModel {
    features: Box<dyn DenseFeatures>,
    recipe: UncertaintyRecipe,
    /// Features of each view's image, from its first comparison on.
    of_images: Vec<Option<FeatureMap>>,
    /// The visibility of the last view that was asked for, at every pixel.
    mask: Image<f32>,
}

impl VisibilityModel {
    /// The model for a number of views.
    #[must_use]
    pub fn new(features: Box<dyn DenseFeatures>, recipe: UncertaintyRecipe, views: usize) -> Self {
        Self { features, recipe, of_images: vec![None; views], mask: Image::default() }
    }

    /// Compares the image of a view with its picture, both as displayed and at full resolution. `draw` is (seed, iteration) of
    /// the head's random numbers.
    ///
    /// # Errors
    /// [`VisibilityError`] if the features cannot be computed.
    pub fn observe(
        &mut self,
        state: &mut VisibilityState,
        view: usize,
        image: &Image<f32>,
        picture: &Image<f32>,
        draw: (u64, u64),
    ) -> Result<(), VisibilityError> {
        state.differences.resize(self.of_images.len(), None);
        let planes = |image: &Image<f32>| -> [Grid2; 3] { std::array::from_fn(|c| image.plane(c)) };
        if self.of_images[view].is_none() {
            self.of_images[view] = Some(self.features.extract(&planes(image))?);
        }
        let Some(of_image) = &self.of_images[view] else { return Ok(()) };
        let newest = dissimilarity(of_image, &self.features.extract(&planes(picture))?, SCALE)?;
        let mean = state.differences[view].get_or_insert_with(|| newest.clone());
        for (mean, newest) in mean.data.iter_mut().zip(&newest.data) {
            *mean += NEWEST * (newest - *mean);
        }
        if self.recipe.model == UncertaintyModel::Head {
            let (own, mut adam) = state.head.take().unzip();
            let mut head = match own {
                Some(own) => UncertaintyHead::from_state(own)?,
                None => UncertaintyHead::new(of_image.channels, draw.0),
            };
            head.train(of_image, &newest, &self.recipe.loss(), draw.0, draw.1)?;
            let (parameters, gradient) = head.parameters_and_gradient();
            adam.get_or_insert_default().step(AdamRule::DEFAULT, parameters, gradient, HEAD_RATE);
            state.head = Some((head.state().clone(), adam.unwrap_or_default()));
        }
        Ok(())
    }

    /// The visibility of a view's patches, 0 to 1; none before its first comparison.
    ///
    /// # Errors
    /// [`VisibilityError`] if the head cannot be evaluated.
    pub fn patches(
        &self,
        state: &VisibilityState,
        view: usize,
    ) -> Result<Option<PatchVisibility>, VisibilityError> {
        let Some(Some(difference)) = state.differences.get(view) else { return Ok(None) };
        let of_patches = |patches| PatchVisibility { patch_px: self.features.patch_px(), patches };
        if let (Some((own, _)), Some(of_image)) = (&state.head, &self.of_images[view]) {
            let head = UncertaintyHead::from_state(own.clone())?;
            return Ok(Some(of_patches(visibility_of_sigma(&head.sigma(of_image)?))));
        }
        Ok(Some(of_patches(self.recipe.loss().visibility(difference))))
    }

    /// The visibility of a view's pixels in an image of this size, counted to a share; one channel. None before the view's
    /// first comparison.
    ///
    /// # Errors
    /// [`VisibilityError`] if the head cannot be evaluated.
    pub fn mask(
        &mut self,
        state: &VisibilityState,
        view: usize,
        (width, height): (usize, usize),
        share: f64,
    ) -> Result<Option<&Image<f32>>, VisibilityError> {
        let Some(patches) = self.patches(state, view)? else { return Ok(None) };
        let visibility = patches.at_pixels((width, height));
        self.mask.resize(width, height, 1);
        for (mask, visibility) in self.mask.data.iter_mut().zip(&visibility.data) {
            *mask = 1.0 + share as f32 * (visibility - 1.0);
        }
        Ok(Some(&self.mask))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::features::HandFeatures;

    fn image(has_car: bool) -> Image<f32> {
        let mut image = Image::zeros(96, 80, 3);
        for (col, row) in (0..96 * 80).map(|i| (i % 96, i / 96)) {
            let street = 0.4 + 0.1 * (col as f32 * 0.4).sin() * (row as f32 * 0.3).cos();
            let is_car = has_car && (40..56).contains(&col) && (32..40).contains(&row);
            for c in 0..3 {
                *image.at_mut(c, col, row) = if is_car { 0.9 - 0.3 * c as f32 } else { street };
            }
        }
        image
    }

    fn recipe(model: UncertaintyModel) -> UncertaintyRecipe {
        UncertaintyRecipe { model, from: 100, full_from: 200, prior: 0.5, visible: 0.15 }
    }

    #[test]
    fn a_car_that_the_picture_lacks_is_less_visible_than_the_street() {
        let mut model =
            VisibilityModel::new(Box::<HandFeatures>::default(), recipe(UncertaintyModel::Closed), 2);
        let mut state = VisibilityState::default();
        assert!(model.mask(&state, 1, (96, 80), 1.0).unwrap().is_none());
        model.observe(&mut state, 1, &image(true), &image(false), (0, 1)).unwrap();
        let mask = model.mask(&state, 1, (96, 80), 1.0).unwrap().unwrap();
        assert!(
            mask.at(0, 48, 36) < 0.7 && mask.at(0, 10, 70) > 0.95,
            "{} {}",
            mask.at(0, 48, 36),
            mask.at(0, 10, 70)
        );
        let half = mask.at(0, 48, 36);
        let mask = model.mask(&state, 1, (96, 80), 0.5).unwrap().unwrap();
        assert!((mask.at(0, 48, 36) - (1.0 + half) / 2.0).abs() < 1e-6);
        assert!(model.mask(&state, 0, (96, 80), 1.0).unwrap().is_none());
    }

    #[test]
    fn the_head_learns_in_steps_that_the_state_holds() {
        let mut model =
            VisibilityModel::new(Box::<HandFeatures>::default(), recipe(UncertaintyModel::Head), 1);
        let (mut state, mut split) = (VisibilityState::default(), VisibilityState::default());
        for step in 0..20 {
            model.observe(&mut state, 0, &image(true), &image(false), (0, step)).unwrap();
            let mut other =
                VisibilityModel::new(Box::<HandFeatures>::default(), recipe(UncertaintyModel::Head), 1);
            other.observe(&mut split, 0, &image(true), &image(false), (0, step)).unwrap();
        }
        assert!(state == split);
        assert!(
            model.patches(&state, 0).unwrap().unwrap().patches.data.iter().all(|v| (0.0..=1.0).contains(v))
        );
    }

    #[test]
    fn visibility_counts_more_and_more() {
        let shares = [99, 100, 150, 200, 900].map(|i| recipe(UncertaintyModel::Closed).share(i));
        assert_eq!(shares, [None, Some(0.0), Some(0.5), Some(1.0), Some(1.0)]);
    }
}
