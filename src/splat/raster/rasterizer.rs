//! The rasteriser: projection, binning, compositing, and the way back.

use super::bands::Band;
use super::block::TILE;
use super::image::Image;
use super::project::{CHUNK, Chunk, FrameCamera, Projection};
use super::sorted::SortedSplats;
use super::splat_block::SplatGradient;
use super::{backward, forward};
use crate::camera::{CameraKernel, QuadraticKernel};
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;

/// Largest number of columns or rows of an image, as tile indices have 16 bits.
pub const MAX_SIDE: usize = TILE << u16::BITS;

/// Renders `C` features of each splat with one camera and computes the gradient; keeps its buffers between calls.
pub struct Rasterizer<T, const C: usize, K = QuadraticKernel<T>> {
    chunks: Vec<Chunk<T>>,
    bands: Vec<Band<T, C>>,
    image: Image<T>,
    /// Camera of the last render.
    camera: FrameCamera<K>,
}

impl<T: Real, const C: usize, K: Default> Default for Rasterizer<T, C, K> {
    fn default() -> Self {
        Self {
            chunks: Vec::new(),
            bands: Vec::new(),
            image: Image::default(),
            camera: FrameCamera::default(),
        }
    }
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>> Rasterizer<T, C, K> {
    /// Renders an image of `C` + 1 channels: the features over `background`, and the transmittance as the last channel.
    /// `features` are in the order of ranks of `sorted`.
    ///
    /// This calls [`Rasterizer::project`], [`Rasterizer::bin`] and [`Rasterizer::draw`] in turn.
    pub fn render(
        &mut self,
        sorted: &SortedSplats<T>,
        features: &[[T; C]],
        camera: &FrameCamera<K>,
        background: [T; C],
    ) -> &Image<T> {
        self.project(sorted, camera);
        self.bin(features);
        self.draw(background);
        &self.image
    }

    /// First step of a render: projects the splats.
    pub fn project(&mut self, sorted: &SortedSplats<T>, camera: &FrameCamera<K>) {
        self.camera = *camera;
        let ranks = sorted.len();
        self.chunks.resize_with(ranks.div_ceil(CHUNK), Default::default);
        self.chunks.par_iter_mut().enumerate().for_each(|(k, chunk)| {
            let ranks = k * CHUNK..ranks.min((k + 1) * CHUNK);
            T::dispatch(Projection { chunk, sorted, ranks, camera });
        });
    }

    /// Second step of a render: lists the splats that touch each tile. `features` are in the order of ranks.
    pub fn bin(&mut self, features: &[[T; C]]) {
        self.bands.resize_with(self.camera.height.div_ceil(TILE), Default::default);
        let (chunks, tiles) = (&self.chunks, self.camera.width.div_ceil(TILE));
        self.bands.par_iter_mut().enumerate().for_each(|(index, band)| {
            band.bin(chunks, features, index, tiles);
        });
    }

    /// Third step of a render: composites the tiles' splats over `background`.
    pub fn draw(&mut self, background: [T; C]) {
        let FrameCamera { width, height, .. } = self.camera;
        self.image.resize(width, height, C + 1);
        let rows = self.image.data.par_chunks_mut(TILE * (C + 1) * width);
        rows.zip(&mut self.bands).enumerate().for_each(|(index, (out, band))| {
            T::dispatch(forward::Forward { band, index, width, background, out });
        });
    }

    /// The image of the last render.
    #[must_use]
    pub fn image(&self) -> &Image<T> {
        &self.image
    }

    /// Adds to `gradients` and `by_feature`, both in the order of ranks of the last render's `sorted`, the derivatives
    /// that follow from `by_pixel`, the loss's derivatives by the `C` features of the last render's pixels.
    ///
    /// This calls [`Rasterizer::pixels_backward`] and [`Rasterizer::gather`] in turn.
    pub fn backward(
        &mut self,
        sorted: &SortedSplats<T>,
        by_pixel: &Image<T>,
        gradients: &mut [SplatGradient<T>],
        by_feature: &mut [[T; C]],
    ) {
        self.pixels_backward(by_pixel);
        self.gather(sorted, gradients, by_feature);
    }

    /// First step of the gradient: sums the derivatives by pixels into a slot for each splat and band.
    pub fn pixels_backward(&mut self, by_pixel: &Image<T>) {
        let width = self.camera.width;
        let images = self.image.data.par_chunks(TILE * (C + 1) * width);
        let derivatives = by_pixel.data.par_chunks(TILE * C * width);
        self.bands.par_iter_mut().zip(images.zip(derivatives)).enumerate().for_each(
            |(index, (band, (image, by_pixel)))| {
                let mut slots = std::mem::take(&mut band.slots);
                slots.clear();
                slots.resize(band.slot_count(), super::gradient_slot::GradientSlot::default());
                let mut products = std::mem::take(&mut band.products);
                products.resize(by_pixel.len() / C, T::zero());
                T::dispatch(backward::Backward {
                    band,
                    index,
                    width,
                    image,
                    by_pixel,
                    products: &mut products,
                    slots: &mut slots,
                });
                (band.slots, band.products) = (slots, products);
            },
        );
    }

    /// Second step of the gradient: sums each splat's slots over the bands and adds the derivatives that follow from them.
    pub fn gather(
        &mut self,
        sorted: &SortedSplats<T>,
        gradients: &mut [SplatGradient<T>],
        by_feature: &mut [[T; C]],
    ) {
        let (bands, camera) = (&self.bands, &self.camera.kernel);
        let outputs = gradients.par_chunks_mut(CHUNK).zip(by_feature.par_chunks_mut(CHUNK));
        self.chunks.par_iter_mut().zip(outputs).enumerate().for_each(
            |(k, (chunk, (gradients, by_feature)))| {
                chunk.gather(k, bands, sorted, camera, gradients, by_feature);
            },
        );
    }

    /// Derivative of the loss with respect to the 2-D mean (column, row) of the splat at a rank, per pixel, as the last
    /// [`Rasterizer::gather`] computed it; none if the splat was not visible in the last render.
    #[must_use]
    pub fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        self.chunks[rank / CHUNK].mean2d_gradient(rank % CHUNK)
    }

    /// Number of splat-pixel pairs that the last render computed: all pixels of every block that a splat touches, up to
    /// early termination.
    #[must_use]
    pub fn computed_pairs(&self) -> usize {
        self.bands.iter().map(|band| band.computed_pairs).sum()
    }
}
