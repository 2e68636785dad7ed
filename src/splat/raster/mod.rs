//! Rendering splats through affine cameras, and the gradient of a render.
//!
//! Along any parallel ray that climbs, a higher point hides a lower one: the altitude of the centres orders the
//! splats once for every camera of an iteration ([`SortedSplats`]). A camera projects them in chunks
//! and each band of sixteen pixel rows is binned into tiles and rendered by one thread ([`Rasterizer`]).
//! A splat's gradients are summed per band, tile by tile, into a slot of its own, and then over the bands, in a fixed
//! order: no atomic sums, and the same bytes for any number of threads.

mod bands;
mod batch;
mod block;
mod kernel;
mod image;
mod prepare;
mod project;
#[cfg(test)]
mod tests;

pub use image::{Image, channel};
pub(in crate::splat) use image::{STRIPES, stripe_rows};
pub use prepare::{SortedSplats, SplatGradient};
pub use project::FrameCamera;

use crate::camera::{AffineKernel, CameraKernel};
use crate::simd::Real;
use crate::simd::SimdReal;
use bands::Band;
use block::TILE;
use project::{CHUNK, Chunk, Projection};
use rayon::prelude::*;

/// Variance of the pixel's own footprint, px², added to every projected covariance (3DGS).
pub const LOW_PASS_PX2: f64 = 0.3;
/// Alpha below which a splat does not touch a pixel.
pub const ALPHA_CUT: f64 = 1.0 / 255.0;
/// Largest alpha.
pub const ALPHA_MAX: f64 = 0.99;
/// Transmittance that a pixel must fall below, with all others of its block, for nothing further to touch it. Blocks are
/// asked after each row of splats.
pub const SATURATED: f64 = 1e-4;

/// Most columns or rows of an image: tiles are counted in 16 bits.
pub const MAX_SIDE: usize = TILE << u16::BITS;

/// Renders `C` features a splat through one camera and gives the gradient; keeps its buffers between calls.
pub struct Rasterizer<T, const C: usize, K = AffineKernel<T>> {
    chunks: Vec<Chunk<T>>,
    bands: Vec<Band<T, C>>,
    image: Image<T>,
    /// The last render's.
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
    /// Renders. `features` are in `prepared`'s order; the image has the `C` features over `background` and, as
    /// its last channel, the transmittance left.
    ///
    /// The same as [`Rasterizer::project`], [`Rasterizer::bin`] and [`Rasterizer::draw`] in a row.
    pub fn render(
        &mut self,
        prepared: &SortedSplats<T>,
        features: &[[T; C]],
        camera: &FrameCamera<K>,
        background: [T; C],
    ) -> &Image<T> {
        self.project(prepared, camera);
        self.bin(features);
        self.draw(background);
        &self.image
    }

    /// Projects the splats.
    pub fn project(&mut self, prepared: &SortedSplats<T>, camera: &FrameCamera<K>) {
        self.camera = *camera;
        let ranks = prepared.len();
        self.chunks.resize_with(ranks.div_ceil(CHUNK), Default::default);
        self.chunks.par_iter_mut().enumerate().for_each(|(k, chunk)| {
            let ranks = k * CHUNK..ranks.min((k + 1) * CHUNK);
            T::dispatch(Projection { chunk, prepared, ranks, camera });
        });
    }

    /// Lists the projected splats of every tile.
    pub fn bin(&mut self, features: &[[T; C]]) {
        self.bands.resize_with(self.camera.height.div_ceil(TILE), Default::default);
        let (chunks, tiles) = (&self.chunks, self.camera.width.div_ceil(TILE));
        self.bands.par_iter_mut().enumerate().for_each(|(index, band)| {
            band.bin(chunks, features, index, tiles);
        });
    }

    /// Draws what is listed.
    pub fn draw(&mut self, background: [T; C]) {
        let FrameCamera { width, height, .. } = self.camera;
        self.image.resize(width, height, C + 1);
        let rows = self.image.data.par_chunks_mut(TILE * (C + 1) * width);
        rows.zip(&mut self.bands).enumerate().for_each(|(index, (out, band))| {
            T::dispatch(kernel::Forward { band, index, width, background, out });
        });
    }

    /// The image of the last render.
    #[must_use]
    pub fn image(&self) -> &Image<T> {
        &self.image
    }

    /// Adds to `gradients` and `by_feature` (both in the order of the render's [`SortedSplats`]) what the loss's
    /// derivatives by the last render's pixels (`by_pixel`, `C` channels) mean for the splats.
    ///
    /// The same as [`Rasterizer::pixels_backward`] and [`Rasterizer::gather`] in a row.
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

    /// Takes derivatives by pixels back to each tile's splats.
    pub fn pixels_backward(&mut self, by_pixel: &Image<T>) {
        let width = self.camera.width;
        let images = self.image.data.par_chunks(TILE * (C + 1) * width);
        let derivatives = by_pixel.data.par_chunks(TILE * C * width);
        self.bands.par_iter_mut().zip(images.zip(derivatives)).enumerate().for_each(
            |(index, (band, (image, by_pixel)))| {
                let mut slots = std::mem::take(&mut band.slots);
                slots.clear();
                slots.resize(band.slot_count(), kernel::GradientSlot::default());
                let mut products = std::mem::take(&mut band.products);
                products.resize(by_pixel.len() / C, T::zero());
                T::dispatch(kernel::Backward {
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

    /// Adds up what [`Rasterizer::pixels_backward`] found for each splat.
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

    /// The loss's derivative by the image position (pixels) of the splat at a rank, as [`Rasterizer::gather`] found
    /// it; none of a splat that the last render did not see.
    #[must_use]
    pub fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        self.chunks[rank / CHUNK].mean2d_gradient(rank % CHUNK)
    }

    /// Number of pairs of a splat and a pixel that the last render computed: of whole blocks that were not hidden yet.
    #[must_use]
    pub fn computed_pairs(&self) -> usize {
        self.bands.iter().map(|band| band.computed_pairs).sum()
    }
}
