//! The perceptual distance (LPIPS) of a crop of the picture to the same crop of the target (SatGS, §3.5).
//!
//! Both are taken as displayed. Invalid pixels are zero in both. Without a network the term is zero.

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::nn::lpips::{Lpips, PlanarRgb};
use crate::simd::{Real, SimdReal};
use crate::splat::raster::{Image, Scaled};

/// The weight and the column, the distance; zero in iterations without a crop.
pub const INFO: TermInfo =
    TermInfo { weights: &["perceptual"], columns: &["perceptual"], scope: TermScope::Any };
/// Columns and rows of a crop.
const SIDE: usize = 128;

/// The term; keeps its buffers between calls.
pub struct Perceptual<T> {
    network: Option<Lpips<T>>,
    crops: [Vec<T>; 2],
    by_crop: Vec<T>,
    by_picture: Image<T>,
    weight: Option<T>,
}

impl<T: Real> Perceptual<T> {
    /// The term with the network of the inputs.
    #[must_use]
    pub fn new(inputs: &mut TermInputs<T>) -> Self {
        let network = inputs.lpips.take();
        let (crops, by_crop, by_picture) = Default::default();
        Self { network, crops, by_crop, by_picture, weight: None }
    }
}

impl<T: SimdReal> LossTerm<T> for Perceptual<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        self.weight = None;
        columns[0] = 0.0;
        let Image { width, height, .. } = *rendered.picture;
        let (Some(network), Some(place), true) = (&mut self.network, rendered.crop, weights[0] > 0.0) else {
            return 0.0;
        };
        let (crop_width, crop_height) = (width.min(SIDE), height.min(SIDE));
        let at = |place: f64, free: usize| ((place * (free + 1) as f64) as usize).min(free);
        let corner = (at(place[0], width - crop_width), at(place[1], height - crop_height));
        for (crop, image) in self.crops.iter_mut().zip([rendered.picture, rendered.target]) {
            crop.clear();
            for (c, row) in (0..3 * crop_height).map(|i| (i / crop_height, corner.1 + i % crop_height)) {
                crop.extend_from_slice(&image.row(c, row)[corner.0..corner.0 + crop_width]);
            }
        }
        let plane = crop_width * crop_height;
        let [picture, target] = self.crops.each_ref().map(|crop| {
            let planes = [&crop[..plane], &crop[plane..2 * plane], &crop[2 * plane..]];
            PlanarRgb::new(crop_width, crop_height, planes)
        });
        let (Ok(picture), Ok(target)) = (picture, target) else { return 0.0 };
        // Images that are too small for the network have no distance.
        let Ok(distance) = network.distance_with_gradient(picture, target, &mut self.by_crop) else {
            return 0.0;
        };
        self.by_picture.resize(width, height, 3);
        self.by_picture.data.fill(T::zero());
        for (i, by) in self.by_crop.chunks_exact(crop_width).enumerate() {
            let (c, row) = (i / crop_height, corner.1 + i % crop_height);
            let start = (row * 3 + c) * width + corner.0;
            self.by_picture.data[start..start + crop_width].copy_from_slice(by);
        }
        self.weight = Some(T::from_f64(weights[0]));
        columns[0] = distance;
        weights[0] * distance
    }

    fn by_picture(&self) -> Option<Scaled<'_, T>> {
        self.weight.map(|factor| Scaled { image: &self.by_picture, factor })
    }
}
