//! From a view's render and the sun's image to the picture, and back (EOGS).
//!
//! From each pixel's altitude the sun's altitude image is looked up: where it lies `Δ` metres higher, the share of
//! sunlight is `exp(ρ min(-Δ, 0))`. The view's radiometry and that share make the picture.

use crate::simd::Real;
use crate::simd::{MAX_LANES, Simd, SimdKernel, SimdMask, SimdReal, SimdVec, broadcast_each};
use crate::splat::appearance::Appearance;
use crate::splat::loss::consistency::Scaled;
use crate::splat::raster::Image;
use crate::splat::shear_warp::{ShearWarp, Window, stripe_rows, sum_windows};
use rayon::prelude::*;

/// Extinction of sunlight per metre that the sun sees something higher (EOGS: fixed).
const SHADOW_RATE_PER_M: f64 = 0.4;
/// Shares of sunlight nearer to 0 or 1 have no entropy (EOGS).
const ENTROPY_CLIP: f64 = 0.05;

/// What a picture is made of.
#[derive(Clone, Copy)]
pub struct Scene<'a, T> {
    /// The view's radiometry.
    pub appearance: &'a Appearance<T>,
    /// Colours and altitudes of the view.
    pub view: &'a Image<T>,
    /// Altitudes in the sun's image and where to find them, if shadows are modelled.
    pub sun: Option<(ShearWarp<T>, &'a Image<T>)>,
    /// Pixels that count, row by row; empty when all do.
    pub valid: &'a [bool],
}

/// What the way back begins with.
#[derive(Clone, Copy)]
pub struct ByPicture<'a, T> {
    /// Derivatives by the picture.
    pub picture: &'a Image<T>,
    /// By the mean entropy.
    pub entropy: f64,
    /// By the view besides.
    pub view: Option<Scaled<'a, T>>,
}

/// Makes pictures; keeps its buffers.
#[derive(Default)]
pub struct ShadowModel<T> {
    picture: Image<T>,
    /// Share of sunlight and, if there is a sun, the derivative of its entropy.
    sunlight: Image<T>,
    by_view: Image<T>,
    by_sun: Image<T>,
    stripes: Vec<Stripe<T>>,
}

/// What a run of rows scatters, and sums.
#[derive(Default)]
struct Stripe<T> {
    by_sun: Window<T, 1>,
    appearance: [T; 15],
    entropy: f64,
}

impl<T: SimdReal> ShadowModel<T> {
    /// Makes the picture.
    pub fn show(&mut self, scene: Scene<T>) {
        let Image { width, height, .. } = *scene.view;
        let rows = stripe_rows(height);
        self.picture.resize(width, height, 3);
        self.sunlight.resize(width, height, 2);
        self.stripes.resize_with(height.div_ceil(rows), Stripe::default);
        let outputs = self.picture.data.par_chunks_mut(rows * 3 * width);
        let outputs = outputs.zip(self.sunlight.data.par_chunks_mut(rows * 2 * width));
        outputs.zip(&mut self.stripes).enumerate().for_each(|(k, ((picture, sunlight), stripe))| {
            let entropy = &mut stripe.entropy;
            T::dispatch(Show { scene, first_row: k * rows, picture, sunlight, entropy });
        });
    }

    /// Mean entropy of the last picture's shares of sunlight, bits.
    #[must_use]
    pub fn entropy(&self) -> f64 {
        let pixels = self.sunlight.width * self.sunlight.height;
        self.stripes.iter().map(|s| s.entropy).sum::<f64>() / pixels as f64
    }

    /// From derivatives by the last picture to those by view and sun's image; returns those by the radiometry.
    pub fn backward(&mut self, scene: Scene<T>, by: ByPicture<T>) -> [T; 15] {
        let Image { width, height, .. } = *scene.view;
        let rows = stripe_rows(height);
        self.by_view.resize(width, height, 4);
        let sunlight = &self.sunlight;
        let outputs = self.by_view.data.par_chunks_mut(rows * 4 * width);
        outputs.zip(&mut self.stripes).enumerate().for_each(|(k, (by_view, stripe))| {
            T::dispatch(PullBack { scene, by, sunlight, first_row: k * rows, by_view, stripe });
        });
        if let Some((_, image)) = scene.sun {
            self.by_sun.resize(image.width, image.height, 1);
            let stripes = &self.stripes;
            sum_windows(&mut self.by_sun, T::one(), |k| stripes.get(k).map(|s| &s.by_sun));
        }
        let mut by_appearance = [T::zero(); 15];
        for stripe in &self.stripes {
            for (sum, by) in by_appearance.iter_mut().zip(stripe.appearance) {
                *sum = *sum + by;
            }
        }
        by_appearance
    }

    /// The picture, three channels.
    #[must_use]
    pub fn picture(&self) -> &Image<T> {
        &self.picture
    }

    /// The share of sunlight in the picture, the first channel.
    #[must_use]
    pub fn sunlight(&self) -> &Image<T> {
        &self.sunlight
    }

    /// Derivatives by the view's colours and altitudes.
    #[must_use]
    pub fn by_view(&self) -> &Image<T> {
        &self.by_view
    }

    /// Derivatives by the altitudes in the sun's image.
    #[must_use]
    pub fn by_sun(&self) -> &Image<T> {
        &self.by_sun
    }
}

/// One where a pixel counts, else zero.
#[inline(always)]
fn counts<S: Simd>(simd: S, valid: &[bool], start: usize) -> SimdVec<S> {
    let (zero, one) = (S::Scalar::from_f64(0.0), S::Scalar::from_f64(1.0));
    if valid.is_empty() {
        return SimdVec::broadcast(simd, one);
    }
    let mut out = [zero; MAX_LANES];
    for (o, v) in out.iter_mut().zip(&valid[start..]) {
        *o = if *v { one } else { zero };
    }
    SimdVec::load(simd, &out)
}

/// A stripe of the picture.
struct Show<'a, T> {
    scene: Scene<'a, T>,
    first_row: usize,
    picture: &'a mut [T],
    sunlight: &'a mut [T],
    entropy: &'a mut f64,
}

impl<T: SimdReal> SimdKernel<T> for Show<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Scene { appearance, view, sun, valid } = self.scene;
        let width = view.width;
        let appearance = Appearance { values: broadcast_each(simd, appearance.values) };
        let [zero, one, rate, low, high] = broadcast_each(
            simd,
            [0.0, 1.0, SHADOW_RATE_PER_M, ENTROPY_CLIP, 1.0 - ENTROPY_CLIP].map(T::from_f64),
        );
        *self.entropy = 0.0;
        let rows = self.picture.chunks_mut(3 * width).zip(self.sunlight.chunks_mut(2 * width));
        for (k, (picture, sunlight)) in rows.enumerate() {
            let row = self.first_row + k;
            let (sunlight, slope) = sunlight.split_at_mut(width);
            let mut entropy = zero;
            for start in (0..width).step_by(S::WIDTH) {
                let mut s = one;
                if let Some((lookup, image)) = &sun {
                    let z = SimdVec::load_from(simd, view.row(3, row), start);
                    let places = lookup.places(simd, start..width, row, z, image);
                    let (higher, _) = places.values(simd, image, 0);
                    s = (rate * (z - higher).select_or_zero(places.inside).min(zero)).exp();
                    // Binary entropy, its logarithms' arguments clipped; only these follow the clip.
                    let clipped = s.max(low).min(high);
                    let (a, b) = (clipped.log2(), (one - clipped).log2());
                    entropy += (s * a + (one - s) * b).select_or_zero(SimdMask::first(simd, width - start));
                    (b - a).store_to(slope, start);
                }
                s.store_to(sunlight, start);
                let mut rgb = [zero; 3];
                for c in 0..3 {
                    rgb[c] = SimdVec::load_from(simd, view.row(c, row), start);
                }
                let (lit, dim) = (appearance.sunlit(rgb), appearance.dimming(s));
                let counts = counts(simd, valid, row * width + start);
                for c in 0..3 {
                    (counts * lit[c] * dim[c]).store_to(&mut picture[c * width..(c + 1) * width], start);
                }
            }
            *self.entropy -= entropy.sum().as_f64();
        }
    }
}

/// The way back from a stripe of the picture.
struct PullBack<'a, T> {
    scene: Scene<'a, T>,
    by: ByPicture<'a, T>,
    sunlight: &'a Image<T>,
    first_row: usize,
    by_view: &'a mut [T],
    stripe: &'a mut Stripe<T>,
}

impl<T: SimdReal> SimdKernel<T> for PullBack<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let Self { scene: Scene { appearance, view, sun, valid }, by, sunlight, first_row, by_view, stripe } =
            self;
        let width = view.width;
        if let Some((lookup, image)) = &sun {
            let rows = first_row..first_row + by_view.len() / (4 * width);
            let altitudes = rows.clone().flat_map(|r| view.row(3, r));
            stripe.by_sun.open(image.width, lookup.rows(rows, altitudes, image.height));
        }
        let appearance = Appearance { values: broadcast_each(simd, appearance.values) };
        let pixels = (width * view.height) as f64;
        let constants = [0.0, 1.0, SHADOW_RATE_PER_M, by.entropy / pixels].map(T::from_f64);
        let [zero, one, rate, entropy_scale] = broadcast_each(simd, constants);
        let mut by_values = [zero; 15];
        for (k, by_view) in by_view.chunks_mut(4 * width).enumerate() {
            let row = first_row + k;
            for start in (0..width).step_by(S::WIDTH) {
                let counts = counts(simd, valid, row * width + start);
                let (mut rgb, mut by_pixel) = ([zero; 3], [zero; 3]);
                for c in 0..3 {
                    rgb[c] = SimdVec::load_from(simd, view.row(c, row), start);
                    by_pixel[c] = counts * SimdVec::load_from(simd, by.picture.row(c, row), start);
                }
                let s = SimdVec::load_from(simd, sunlight.row(0, row), start);
                let (by_rgb, by_s) = appearance.backward(rgb, s, by_pixel, &mut by_values);
                let mut sums = [by_rgb[0], by_rgb[1], by_rgb[2], zero];
                if let Some((lookup, image)) = &sun {
                    let by_entropy = SimdVec::load_from(simd, sunlight.row(1, row), start);
                    let by_s = entropy_scale.mul_add(by_entropy, by_s);
                    let z = SimdVec::load_from(simd, view.row(3, row), start);
                    let places = lookup.places(simd, start..width, row, z, image);
                    let (higher, slopes) = places.values(simd, image, 0);
                    let shaded = higher.greater_than(z).and(places.inside);
                    let by_delta = (rate * s * by_s).select_or_zero(shaded);
                    places.scatter(simd, shaded, [zero - by_delta], &mut stripe.by_sun);
                    sums[3] = by_delta * (one - lookup.by_altitude(simd, slopes));
                }
                if let Some(besides) = by.view {
                    let factor = SimdVec::broadcast(simd, besides.factor);
                    for c in 0..4 {
                        sums[c] = factor
                            .mul_add(SimdVec::load_from(simd, besides.layers.row(c, row), start), sums[c]);
                    }
                }
                for c in 0..4 {
                    sums[c].store_to(&mut by_view[c * width..(c + 1) * width], start);
                }
            }
        }
        stripe.appearance = by_values.map(SimdVec::sum);
    }
}
