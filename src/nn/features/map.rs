//! Maps of feature vectors, and what makes them.

use super::FeatureError;
use crate::io::Grid2;

/// A feature vector for each patch of a picture.
///
/// Patches are squares, the first one at the picture's top left corner. Those at the right and lower border may reach beyond
/// the picture: there are `ceil(width / patch)` columns and `ceil(height / patch)` rows.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureMap {
    /// Columns of patches.
    pub width: usize,
    /// Rows of patches.
    pub height: usize,
    /// Length of a vector.
    pub channels: usize,
    /// The vectors one after the other, row by row from the top: `width * height * channels` finite numbers.
    pub data: Vec<f32>,
}

impl FeatureMap {
    /// The vector of a patch.
    ///
    /// # Panics
    /// Panics if the patch is outside of the map.
    #[must_use]
    pub fn at(&self, col: usize, row: usize) -> &[f32] {
        &self.data[(row * self.width + col) * self.channels..][..self.channels]
    }
}

/// A way to describe the content of a picture patch by patch, such that equal content has nearly parallel vectors under
/// different light, and different content has not.
pub trait DenseFeatures: Send {
    /// Side of a patch, pixels.
    fn patch_px(&self) -> usize;

    /// Length of a feature vector.
    fn channels(&self) -> usize;

    /// The features of a picture: red, green and blue as displayed. Values are clamped to [0, 1], and NaN counts as 0.
    ///
    /// # Errors
    /// [`FeatureError`] if the planes differ in size or are empty, or if a network cannot be evaluated.
    fn extract(&mut self, rgb: &[Grid2; 3]) -> Result<FeatureMap, FeatureError>;
}

/// Columns and rows of a picture whose planes have one size.
pub(super) fn picture_size(rgb: &[Grid2; 3]) -> Result<(usize, usize), FeatureError> {
    let planes = rgb.each_ref().map(|plane| (plane.width, plane.height, plane.data.len()));
    let (width, height, values) = planes[0];
    if planes.iter().any(|&p| p != planes[0]) || values == 0 || Some(values) != width.checked_mul(height) {
        return Err(FeatureError::Picture { planes });
    }
    Ok((width, height))
}

/// A value as a screen shows it: between 0 and 1, black where there is none.
#[inline(always)]
pub(super) fn displayed(value: f32) -> f32 {
    if value > 0.0 { value.min(1.0) } else { 0.0 }
}
