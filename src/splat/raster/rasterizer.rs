//! The rasteriser: projection, binning, compositing, and the way back.

use super::bands::Band;
use super::block::TILE;
use super::gather::Gather;
use super::image::Image;
use super::primitive::{Ellipsoid, Primitive};
use super::project::{CHUNK, Chunk, FrameCamera, Projection};
use super::sorted::SortedSplats;
use super::splat_block::SplatGradient;
use super::{backward, forward};
use crate::camera::{CameraKernel, QuadraticKernel};
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;
use std::marker::PhantomData;

/// Largest number of columns or rows of an image, as tile indices have 16 bits.
pub const MAX_SIDE: usize = TILE << u16::BITS;

/// Renders `C` features of each splat with one camera and computes the gradient; keeps its buffers between calls.
pub struct Rasterizer<T: Real, const C: usize, K = QuadraticKernel<T>, P: Primitive = Ellipsoid> {
    chunks: Vec<Chunk<T, P>>,
    bands: Vec<Band<T, C, P>>,
    image: Image<T>,
    /// Camera of the last render.
    camera: FrameCamera<K>,
}

impl<T: Real, const C: usize, K: Default, P: Primitive> Default for Rasterizer<T, C, K, P> {
    fn default() -> Self {
        Self {
            chunks: Vec::new(),
            bands: Vec::new(),
            image: Image::default(),
            camera: FrameCamera::default(),
        }
    }
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>, P: Primitive> Rasterizer<T, C, K, P> {
    /// Renders an image: the features over `background`, and the transmittance; of [`DiscWithMoments`](super::DiscWithMoments)
    /// all planes. `features` are in the order of ranks of `sorted`; those of discs have the depth of the centre in
    /// channel 3, or as their only one, as [`CameraKernel::ORDER`] has it: altitude or distance.
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
        self.image.resize(width, height, P::planes(C));
        let rows = self.image.data.par_chunks_mut(TILE * P::planes(C) * width);
        rows.zip(&mut self.bands).enumerate().for_each(|(index, (out, band))| {
            T::dispatch(forward::Forward { band, kernel: PhantomData::<K>, index, width, background, out });
        });
    }

    /// The image of the last render.
    #[must_use]
    pub fn image(&self) -> &Image<T> {
        &self.image
    }

    /// Adds to `gradients` and `by_feature`, both in the order of ranks of the last render's `sorted`, the derivatives
    /// that follow from `by_pixel`, the loss's derivatives by the last render's pixels: by the `C` features, and of
    /// primitives that [train all planes](Primitive::TRAINS_ALL_PLANES) by all of them.
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
        let trained = P::trained_planes(C);
        let images = self.image.data.par_chunks(TILE * P::planes(C) * width);
        let derivatives = by_pixel.data.par_chunks(TILE * trained * width);
        self.bands.par_iter_mut().zip(images.zip(derivatives)).enumerate().for_each(
            |(index, (band, (image, by_pixel)))| {
                let mut slots = std::mem::take(&mut band.slots);
                slots.clear();
                slots.resize(band.slot_count(), super::gradient_slot::GradientSlot::default());
                let mut products = std::mem::take(&mut band.products);
                products.resize(by_pixel.len() / trained, T::zero());
                T::dispatch(backward::Backward {
                    band,
                    kernel: PhantomData::<K>,
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
                T::dispatch(Gather { chunk, index: k, bands, sorted, camera, gradients, by_feature });
            },
        );
    }

    /// Derivative of the loss with respect to the 2-D mean (column, row) of the splat at a rank, per pixel, as the last
    /// [`Rasterizer::gather`] computed it; none if the splat was not visible in the last render.
    #[must_use]
    pub fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        self.chunks[rank / CHUNK].mean2d_gradient(rank % CHUNK)
    }

    /// Adds to `by_normal`, in the order of ranks, the derivatives of the loss by the normals of discs, as the last
    /// [`Rasterizer::gather`] computed them.
    pub fn add_normal_gradients(&self, by_normal: &mut [[T; 3]]) {
        by_normal.par_chunks_mut(CHUNK).zip(&self.chunks).for_each(|(sums, chunk)| {
            for (sum, by) in sums.iter_mut().zip(&chunk.normal_gradients) {
                super::gradient_slot::add(sum, *by);
            }
        });
    }

    /// Number of splat-pixel pairs that the last render computed: all pixels of every block that a splat touches, up to
    /// early termination.
    #[must_use]
    pub fn computed_pairs(&self) -> usize {
        self.bands.iter().map(|band| band.computed_pairs).sum()
    }
}
