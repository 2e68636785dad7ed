//! What a splat is: an ellipsoid (3DGS) or a flat disc (2DGS, Huang et al. 2024).
//!
//! A disc is a Gaussian whose third axis, the normal, has no extent. Its image under a linearised camera is the same ellipse
//! as that of a flat ellipsoid, but its depth varies over the pixels like that of its plane. With the offset `d` of a pixel
//! from the projection of the centre and the *slope* `g` of the plane:
//!
//! - In a parallel projection the altitude is `z + g . d`, with `g` in metres per pixel, and the ellipse is exact.
//! - In a perspective projection the depth is `z / (1 + g . d)`, with `g` in 1/pixel, and the exponent of the Gaussian is that
//!   of the ellipse divided by `(1 + g . d)²`: the intersection of each pixel's ray with the disc, without approximation
//!   but for the low-pass filter (2DGS §4.1, solved for the pixel).

use crate::simd::Real;
use std::fmt::Debug;

/// Numbers of type `T` that a primitive stores, or none.
pub trait StoredNumbers<T: Real, const N: usize>: Copy + Debug + Default + Send + Sync {
    /// Stores the numbers.
    fn of(numbers: [T; N]) -> Self;
    /// The numbers; zeros if none are stored.
    fn get(self) -> [T; N];
}

impl<T: Real, const N: usize> StoredNumbers<T, N> for () {
    #[inline(always)]
    fn of(_: [T; N]) -> Self {}

    #[inline(always)]
    fn get(self) -> [T; N] {
        [T::zero(); N]
    }
}

impl<T: Real> StoredNumbers<T, 2> for [T; 2] {
    #[inline(always)]
    fn of(numbers: [T; 2]) -> Self {
        numbers
    }

    #[inline(always)]
    fn get(self) -> [T; 2] {
        self
    }
}

impl<T: Real> StoredNumbers<T, 4> for [T; 4] {
    #[inline(always)]
    fn of(numbers: [T; 4]) -> Self {
        numbers
    }

    #[inline(always)]
    fn get(self) -> [T; 4] {
        self
    }
}

/// A kind of splat that the rasteriser is compiled for.
pub trait Primitive: Copy + Debug + Default + Send + Sync + 'static {
    /// Whether the depth varies over the image of a splat as that of its plane.
    const IS_FLAT: bool;
    /// Number of planes after the features: two moments of the mapped depth, for the distortion loss (2DGS §5).
    const MOMENTS: usize = 0;
    /// Number of planes after the transmittance: the median depth.
    const MEDIANS: usize = 0;
    /// Whether the loss has derivatives by all planes of an image, not only by those of the features.
    const TRAINS_ALL_PLANES: bool = false;
    /// The slope of the plane.
    type Slope<T: Real>: StoredNumbers<T, 2>;
    /// Sums over pixels from which the derivative by the slope follows.
    type SlopeSums<T: Real>: StoredNumbers<T, 4>;

    /// Index of the feature that is the depth of the centre and varies over the image of a disc: the only one, or the one
    /// after the colours.
    #[inline(always)]
    fn is_depth(feature: usize, features: usize) -> bool {
        Self::IS_FLAT && feature == if features == 1 { 0 } else { super::channel::DEPTH }
    }

    /// Number of planes of an image with so many features.
    #[inline(always)]
    fn planes(features: usize) -> usize {
        features + Self::MOMENTS + 1 + Self::MEDIANS
    }

    /// Number of planes by which the loss has derivatives.
    #[inline(always)]
    fn trained_planes(features: usize) -> usize {
        if Self::TRAINS_ALL_PLANES { Self::planes(features) } else { features }
    }
}

/// An ellipsoid: every feature is the same in all pixels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ellipsoid;

impl Primitive for Ellipsoid {
    const IS_FLAT: bool = false;
    type Slope<T: Real> = ();
    type SlopeSums<T: Real> = ();
}

/// An ellipsoid with derivatives by the transmittance too.
#[derive(Clone, Copy, Debug, Default)]
pub struct EllipsoidWithTransmittance;

impl Primitive for EllipsoidWithTransmittance {
    const IS_FLAT: bool = false;
    const TRAINS_ALL_PLANES: bool = true;
    type Slope<T: Real> = ();
    type SlopeSums<T: Real> = ();
}

/// A flat disc: the planes are the features, with the depth as its plane has it, and the transmittance.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disc;

impl Primitive for Disc {
    const IS_FLAT: bool = true;
    type Slope<T: Real> = [T; 2];
    type SlopeSums<T: Real> = [T; 4];
}

/// A flat disc with all planes, and derivatives by all of them: features, two moments of the mapped depth, transmittance,
/// median depth.
#[derive(Clone, Copy, Debug, Default)]
pub struct DiscWithMoments;

impl Primitive for DiscWithMoments {
    const IS_FLAT: bool = true;
    const MOMENTS: usize = 2;
    const MEDIANS: usize = 1;
    const TRAINS_ALL_PLANES: bool = true;
    type Slope<T: Real> = [T; 2];
    type SlopeSums<T: Real> = [T; 4];
}
