//! A view as it is matched: its gray values and its camera.

use crate::affine::{TrainingView, ViewCamera};
use crate::frame::{Point, Site};
use crate::io::{Grid2, ValidPixels, Window};
use std::sync::Arc;

/// The gray values of a view, with its camera.
pub(super) struct MatchImage {
    /// Square root of linear radiance ([`TrainingView::sqrt_gray`]); NaN where the image has no valid pixel.
    pub gray: Grid2,
    /// Mask of the valid pixels; none if all pixels are valid, or if the NaN in `gray` say which are.
    valid: Option<Arc<ValidPixels>>,
    pub camera: ViewCamera,
    /// Mean of the gray values of the whole image.
    pub mean: f64,
    /// Standard deviation of the gray values of the whole image.
    pub std_dev: f64,
}

impl MatchImage {
    pub fn new(view: &TrainingView) -> Self {
        let gray = view.sqrt_gray();
        let mean_of = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / f64::max(n, 1.0)
        };
        let mean = mean_of(&mut gray.valid().map(f64::from));
        let variance = mean_of(&mut gray.valid().map(|v| (f64::from(v) - mean).powi(2)));
        let valid = view.valid_pixels().cloned();
        Self { camera: view.camera, mean, std_dev: variance.sqrt(), gray, valid }
    }

    /// A window of the image with its camera. Mean and standard deviation remain those of the whole image.
    pub fn cropped(&self, part: Window) -> Self {
        let camera = self.camera.cropped(part.col as f64, part.row as f64);
        Self { gray: self.gray.window(part), valid: None, camera, ..*self }
    }

    /// Gray value at the projection of a point, bilinear, in standard deviations above the mean of the image;
    /// NaN outside.
    pub fn normalized_gray(&self, p: Point<Site>) -> f32 {
        let px = self.camera.project(p);
        ((f64::from(self.gray.bilinear(px.col, px.row)) - self.mean) / self.std_dev) as f32
    }

    /// Whether a point projects into the image, onto valid pixels.
    pub fn covers(&self, p: Point<Site>) -> bool {
        let px = self.camera.project(p);
        if let Some(valid) = &self.valid {
            return valid.surround(px);
        }
        let within = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        within(px.col, self.gray.width) && within(px.row, self.gray.height)
    }
}
