//! LPIPS, the learned perceptual distance of images (Zhang, Isola, Efros, Shechtman and Wang, "The Unreasonable Effectiveness of
//! Deep Features as a Perceptual Metric", CVPR 2018), version 0.1: how much the features of two images differ in
//! several layers of a network that was trained to name what images show.
//!
//! The weights are not part of satgs; `scripts/fetch-weights` makes files of them.

mod architecture;
mod comparison;
mod error;
mod file;
mod image;
mod input;
mod network;

#[cfg(test)]
mod file_tests;
#[cfg(test)]
mod naive_tests;
#[cfg(test)]
mod tests;

pub use architecture::Backbone;
pub use error::LpipsError;
pub use image::PlanarRgb;

use crate::simd::SimdReal;
use network::{Buffers, Network};
use std::path::Path;

/// The distance with the weights of one network; keeps its buffers between gradients.
pub struct Lpips<T> {
    backbone: Backbone,
    network: Network<T>,
    buffers: Buffers<T>,
}

impl<T: SimdReal> Lpips<T> {
    /// Reads weights from a safetensors file. The network, AlexNet or VGG16, is recognised by its first convolution. The file
    /// holds f32 tensors `features.N.weight` and `features.N.bias` as in torchvision, and the weights of channels
    /// `lin0.model.1.weight` to `lin4.model.1.weight` as in the authors' package; other tensors are ignored.
    ///
    /// # Errors
    /// [`LpipsError`] if the file cannot be read, is damaged, or is not of such a network.
    pub fn read(path: &Path) -> Result<Self, LpipsError> {
        let (backbone, network) = file::read(path)?;
        Ok(Self { backbone, network, buffers: Buffers::default() })
    }

    /// The network.
    #[must_use]
    pub fn backbone(&self) -> Backbone {
        self.backbone
    }

    /// The distance of two images: 0 if they are equal, seldom above 1. It is symmetric. Pixels without data (NaN) make it
    /// meaningless.
    ///
    /// It takes about 1 kB of memory for each pixel with VGG16, and a tenth of that with AlexNet (f32).
    ///
    /// # Errors
    /// [`LpipsError`] if the images differ in size, or have less than [`Backbone::smallest_side_px`] columns or rows.
    pub fn distance(&self, a: PlanarRgb<'_, T>, b: PlanarRgb<'_, T>) -> Result<f64, LpipsError> {
        self.check_sizes(&a, &b)?;
        Ok(self.network.distance([a, b]))
    }

    /// The distance of a picture from a target. Sets `by_picture` to its derivatives by the values of the picture, in [0, 1]: red,
    /// then green, then blue, row by row.
    ///
    /// It takes about 3 kB of memory for each pixel with VGG16 (f32), which are kept for the next call.
    ///
    /// # Errors
    /// As [`Lpips::distance`].
    pub fn distance_with_gradient(
        &mut self,
        picture: PlanarRgb<'_, T>,
        target: PlanarRgb<'_, T>,
        by_picture: &mut Vec<T>,
    ) -> Result<f64, LpipsError> {
        self.check_sizes(&picture, &target)?;
        Ok(self.network.distance_with_gradient(picture, target, &mut self.buffers, by_picture))
    }

    fn check_sizes(&self, a: &PlanarRgb<'_, T>, b: &PlanarRgb<'_, T>) -> Result<(), LpipsError> {
        let [first, second] = [a, b].map(|image| (image.width(), image.height()));
        let (width, height) = first;
        let smallest = self.backbone.smallest_side_px();
        if first != second {
            Err(LpipsError::Sizes { first, second })
        } else if width.min(height) < smallest {
            Err(LpipsError::TooSmall { width, height, smallest })
        } else {
            Ok(())
        }
    }
}
