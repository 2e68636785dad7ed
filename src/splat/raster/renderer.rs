//! A rasteriser for a kind of splat that is chosen while the program runs.

use super::primitive::{Disc, Ellipsoid, Primitive};
use super::{FrameCamera, Image, Rasterizer, SortedSplats, SplatGradient};
use crate::camera::CameraKernel;
use crate::simd::SimdReal;
use crate::splat::primitive::PrimitiveKind;

/// The steps of [`Rasterizer`], for any primitive. The derivatives by pixels are those by the features.
pub trait Renderer<T, const C: usize, K>: Send + Sync {
    /// [`Rasterizer::project`].
    fn project(&mut self, sorted: &SortedSplats<T>, camera: &FrameCamera<K>);
    /// [`Rasterizer::bin`].
    fn bin(&mut self, features: &[[T; C]]);
    /// [`Rasterizer::draw`].
    fn draw(&mut self, background: [T; C]);
    /// [`Rasterizer::image`].
    fn image(&self) -> &Image<T>;
    /// [`Rasterizer::pixels_backward`].
    fn pixels_backward(&mut self, by_pixel: &Image<T>);
    /// [`Rasterizer::gather`], and [`Rasterizer::add_normal_gradients`] for discs.
    fn gather(
        &mut self,
        sorted: &SortedSplats<T>,
        gradients: &mut [SplatGradient<T>],
        by_normal: &mut [[T; 3]],
        by_feature: &mut [[T; C]],
    );
    /// [`Rasterizer::mean2d_gradient`].
    fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]>;
}

/// The rasteriser of a kind of splat.
#[must_use]
pub fn renderer<T: SimdReal, const C: usize, K: CameraKernel<T> + 'static>(
    primitive: PrimitiveKind,
) -> Box<dyn Renderer<T, C, K>> {
    match primitive {
        PrimitiveKind::Ellipsoid => Box::new(Rasterizer::<T, C, K, Ellipsoid>::default()),
        PrimitiveKind::Disc => Box::new(Rasterizer::<T, C, K, Disc>::default()),
    }
}

impl<T: SimdReal, const C: usize, K: CameraKernel<T>, P: Primitive> Renderer<T, C, K>
    for Rasterizer<T, C, K, P>
{
    fn project(&mut self, sorted: &SortedSplats<T>, camera: &FrameCamera<K>) {
        Self::project(self, sorted, camera);
    }

    fn bin(&mut self, features: &[[T; C]]) {
        Self::bin(self, features);
    }

    fn draw(&mut self, background: [T; C]) {
        Self::draw(self, background);
    }

    fn image(&self) -> &Image<T> {
        Self::image(self)
    }

    fn pixels_backward(&mut self, by_pixel: &Image<T>) {
        Self::pixels_backward(self, by_pixel);
    }

    fn gather(
        &mut self,
        sorted: &SortedSplats<T>,
        gradients: &mut [SplatGradient<T>],
        by_normal: &mut [[T; 3]],
        by_feature: &mut [[T; C]],
    ) {
        Self::gather(self, sorted, gradients, by_feature);
        if P::IS_FLAT {
            self.add_normal_gradients(by_normal);
        }
    }

    fn mean2d_gradient(&self, rank: usize) -> Option<[T; 2]> {
        Self::mean2d_gradient(self, rank)
    }
}
