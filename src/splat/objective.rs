//! One iteration's loss and its gradient: the view, the sun and a virtual camera rendered from one preparation.
//!
//! EOGS's model. The view is rendered with four features (colour, altitude). From each pixel's altitude the sun's
//! altitude image is looked up: where it lies `Δ` metres higher, the share of sunlight is `exp(ρ min(-Δ, 0))`. The
//! view's radiometry and that share make the picture, which is compared with the image. A randomly sheared camera
//! must show the same altitude and colour where it sees the same surface.

use super::appearance::Appearance;
use super::gaussians::{Gaussians, SH_C0};
use super::lanes::{Kernel, LANES, Lanes, Lanewise, Row, splat_each, sum_each};
use super::lookup::{Lookup, Pixels, Window};
use super::raster::{FrameCamera, Layers, Prepared, Rasterizer, SplatGradient};
use super::real::Real;
use super::ssim::{Photometric, Similarity};
use super::stopwatch::Stopwatch;
use crate::affine::AffineCamera;
use rayon::prelude::*;
use std::ops::Range;

/// Extinction of sunlight per metre that the sun sees something higher (EOGS: fixed).
const SHADOW_RATE_PER_M: f64 = 0.4;
/// Altitudes that differ by less are the same surface to the virtual camera, metres (EOGS).
const SAME_SURFACE_M: f64 = 0.30;
/// Shares of sunlight nearer to 0 or 1 have no entropy (EOGS).
const ENTROPY_CLIP: f64 = 0.05;
/// Runs of rows that scatter into windows of their own; fixed, so that sums do not depend on the threads.
const STRIPES: usize = 8;

/// The renders, as the stopwatch calls them.
const VIEW: &str = "view";
const SUN: &str = "sun image";
const VIRTUAL: &str = "virtual view";

/// What the loss weighs (EOGS's names in brackets).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LossWeights {
    /// Mean opacity over the splats (`L_opacity`).
    pub opacity: f64,
    /// Virtual camera's altitude, per metre (`L_new_altitude`).
    pub consistency_altitude: f64,
    /// Virtual camera's colour (`L_new_rgb`).
    pub consistency_color: f64,
    /// Entropy of the shares of sunlight (`L_translucentshadows`).
    pub shadow_entropy: f64,
}

impl LossWeights {
    /// Whether a virtual view weighs anything.
    #[must_use]
    pub fn has_consistency(&self) -> bool {
        self.consistency_altitude > 0.0 || self.consistency_color > 0.0
    }
}

/// Another camera of the view's family, as the view's pixels reach it.
#[derive(Clone, Copy, Debug)]
pub struct Sheared<T> {
    camera: FrameCamera<T>,
    lookup: Lookup<T>,
}

impl<T: Real> Sheared<T> {
    /// The sun's image of all the view's pixels at altitudes `low..high`.
    #[must_use]
    pub fn sun(view: &AffineCamera, size: (usize, usize), shear: [f64; 2], (low, high): (f64, f64)) -> Self {
        let axis = |s: f64, n: usize| {
            let (a, b) = ((-s * low).min(-s * high), (-s * low).max(-s * high));
            let origin = a.floor();
            (origin, n + (b - origin).ceil() as usize + 1)
        };
        let ((col, width), (row, height)) = (axis(shear[0], size.0), axis(shear[1], size.1));
        Self {
            camera: FrameCamera::new(&view.sheared(shear).cropped(col, row), width, height),
            lookup: Lookup { shear: shear.map(T::of), origin: [T::of(col), T::of(row)] },
        }
    }

    /// A virtual view of the view's own size, pivoting at the site's origin.
    #[must_use]
    pub fn virtual_view(view: &AffineCamera, size: (usize, usize), shear: [f64; 2]) -> Self {
        Self {
            camera: FrameCamera::new(&view.sheared(shear), size.0, size.1),
            lookup: Lookup { shear: shear.map(T::of), origin: [T::zero(); 2] },
        }
    }
}

/// What an iteration looks at.
pub struct Shot<'a, T> {
    /// The view's camera.
    pub camera: FrameCamera<T>,
    /// The view's image, colours in [0, 1]; zero where masked.
    pub truth: &'a Layers<T>,
    /// Pixels that count, row by row; empty when all do.
    pub valid: &'a [bool],
    /// The sun's image, if shadows are modelled.
    pub sun: Option<Sheared<T>>,
    /// The virtual camera, if consistency is asked for.
    pub virtual_view: Option<Sheared<T>>,
    /// Colour behind the splats.
    pub background: [T; 3],
    /// Altitude behind the splats, metres above the site's origin.
    pub floor: T,
}

/// The loss and its terms, unweighted.
#[derive(Clone, Copy, Debug, Default)]
pub struct Losses {
    /// The weighted sum.
    pub total: f64,
    /// The picture against the image.
    pub picture: Similarity,
    /// Mean opacity.
    pub opacity: f64,
    /// Mean altitude difference to the virtual camera, metres.
    pub consistency_altitude: f64,
    /// Mean colour difference to the virtual camera.
    pub consistency_color: f64,
    /// Mean entropy of the shares of sunlight, bits.
    pub shadow_entropy: f64,
}

/// Derivatives of the loss by everything that is trained.
#[derive(Clone, Debug, Default)]
pub struct Gradient<T> {
    /// By the splats' parameters.
    pub splats: Gaussians<T>,
    /// By the view's radiometry.
    pub appearance: [T; 15],
}

/// Computes losses and gradients; keeps every buffer between iterations.
#[derive(Default)]
pub struct Objective<T: Real> {
    prepared: Prepared<T>,
    view: Rasterizer<T, 4>,
    sun: Rasterizer<T, 1>,
    virtual_view: Rasterizer<T, 4>,
    /// The virtual view, to be looked up.
    virtual_pixels: Vec<[T; 4]>,
    features: Vec<[T; 4]>,
    altitudes: Vec<[T; 1]>,
    by_feature: Vec<[T; 4]>,
    by_altitude: Vec<[T; 1]>,
    by_shared: Vec<SplatGradient<T>>,
    /// Share of sunlight and, if there is a sun, the derivative of its entropy.
    sunlight: Layers<T>,
    picture: Layers<T>,
    photometric: Photometric<T>,
    by_view: Layers<T>,
    by_sun: Layers<T>,
    by_virtual: Layers<T>,
    stripes: Vec<Stripe<T>>,
}

/// What a run of rows scatters, and sums.
#[derive(Default)]
struct Stripe<T> {
    by_sun: Window<T, 1>,
    by_virtual: Window<T, 4>,
    appearance: [T; 15],
    entropy: f64,
    agreement: Agreement,
}

/// Sums over pixels that see the same surface in the virtual view.
#[derive(Clone, Copy, Default)]
struct Agreement {
    pixels: f64,
    altitude: f64,
    color: f64,
}

impl<T: Lanewise> Objective<T> {
    /// The loss of one shot; its gradient goes to `gradient`, the time that stages took to `watch`.
    pub fn evaluate(
        &mut self,
        gaussians: &Gaussians<T>,
        appearance: &Appearance<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses {
        self.show(gaussians, appearance, shot, watch);
        let (similarity, _) = self.photometric.compare(&self.picture, shot.truth);
        watch.lap("pixels", "SSIM and L1");
        self.pixels_backward(appearance, shot, weights, gradient);
        watch.lap("pixels", "picture backward");
        self.splats_backward(gaussians, shot, weights, gradient, watch);

        let pixels = (shot.camera.width * shot.camera.height) as f64;
        let sum = |of: fn(&Stripe<T>) -> f64| self.stripes.iter().map(of).sum::<f64>();
        let agreeing = sum(|s| s.agreement.pixels).max(1.0);
        let mut losses = Losses {
            total: 0.0,
            picture: similarity,
            opacity: (0..gaussians.len()).map(|rank| self.prepared.opacity(rank).wide()).sum::<f64>()
                / gaussians.len().max(1) as f64,
            consistency_altitude: sum(|s| s.agreement.altitude) / agreeing,
            consistency_color: sum(|s| s.agreement.color) / agreeing,
            shadow_entropy: sum(|s| s.entropy) / pixels,
        };
        losses.total = similarity.loss()
            + weights.opacity * losses.opacity
            + weights.consistency_altitude * losses.consistency_altitude
            + weights.consistency_color * losses.consistency_color
            + weights.shadow_entropy * losses.shadow_entropy;
        watch.lap("splats", "parameters backward");
        losses
    }

    /// Makes the picture of one shot; its `truth` and `valid` do not matter.
    pub fn show(
        &mut self,
        gaussians: &Gaussians<T>,
        appearance: &Appearance<T>,
        shot: &Shot<T>,
        watch: &mut Stopwatch,
    ) {
        self.prepare(gaussians);
        watch.lap("splats", "order and covariances");
        let [r, g, b] = shot.background;
        let background = [r, g, b, shot.floor];
        let prepared = &self.prepared;
        draw(&mut self.view, VIEW, prepared, &self.features, &shot.camera, background, watch);
        if let Some(sun) = &shot.sun {
            draw(&mut self.sun, SUN, prepared, &self.altitudes, &sun.camera, [shot.floor], watch);
        }
        if let Some(v) = &shot.virtual_view {
            draw(&mut self.virtual_view, VIRTUAL, prepared, &self.features, &v.camera, background, watch);
            side_by_side(self.virtual_view.image(), &mut self.virtual_pixels);
        }

        self.compose(appearance, shot);
        watch.lap("pixels", "picture");
    }

    /// The view's render of the last evaluation: colours, altitude, transmittance.
    #[must_use]
    pub fn view(&self) -> &Layers<T> {
        self.view.image()
    }

    /// The picture of the last evaluation, three channels.
    #[must_use]
    pub fn picture(&self) -> &Layers<T> {
        &self.picture
    }

    /// The share of sunlight in the last evaluation's picture, the first channel.
    #[must_use]
    pub fn sunlight(&self) -> &Layers<T> {
        &self.sunlight
    }

    /// The derivative by a splat's image position, if the last evaluation's view saw it.
    #[must_use]
    pub fn seen(&self, splat: usize) -> Option<[T; 2]> {
        self.view.seen(self.prepared.rank(splat))
    }

    fn prepare(&mut self, gaussians: &Gaussians<T>) {
        self.prepared.update(gaussians);
        let order = self.prepared.order();
        let color = |v: T| v * T::of(SH_C0) + T::of(0.5);
        self.features.resize(order.len(), [T::zero(); 4]);
        self.altitudes.resize(order.len(), [T::zero(); 1]);
        let features = self.features.par_iter_mut().zip(&mut self.altitudes).zip(order);
        features.with_min_len(1024).for_each(|((feature, altitude), &i)| {
            let (f, z) = (gaussians.f_dc[i as usize], gaussians.position[i as usize][2]);
            *feature = [color(f[0]), color(f[1]), color(f[2]), z];
            *altitude = [z];
        });
    }

    /// Makes the picture from the renders, and counts the pixels that agree with the virtual view.
    fn compose(&mut self, appearance: &Appearance<T>, shot: &Shot<T>) {
        let (width, height) = (shot.camera.width, shot.camera.height);
        let rows = height.div_ceil(STRIPES);
        self.picture.resize(width, height, 3);
        self.sunlight.resize(width, height, 2);
        self.stripes.resize_with(height.div_ceil(rows), Stripe::default);
        let (view, sun) = (self.view.image(), sun_pixels(self.sun.image()));
        let virtual_view = virtual_pixels(self.virtual_view.image(), &self.virtual_pixels);
        let outputs = self.picture.data.par_chunks_mut(rows * 3 * width);
        let outputs = outputs.zip(self.sunlight.data.par_chunks_mut(rows * 2 * width));
        outputs.zip(&mut self.stripes).enumerate().for_each(|(k, ((picture, sunlight), stripe))| {
            let first_row = k * rows;
            T::dispatch(Compose {
                appearance,
                shot,
                view,
                sun,
                virtual_view,
                first_row,
                picture,
                sunlight,
                stripe,
            });
        });
    }

    /// From the picture's derivatives to those by the three renders.
    fn pixels_backward(
        &mut self,
        appearance: &Appearance<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
    ) {
        let (width, height) = (shot.camera.width, shot.camera.height);
        let rows = height.div_ceil(STRIPES);
        let agreeing = self.stripes.iter().map(|s| s.agreement.pixels).sum::<f64>().max(1.0);
        self.by_view.resize(width, height, 4);
        let pass = PixelPass {
            appearance,
            shot,
            view: self.view.image(),
            sun: sun_pixels(self.sun.image()),
            virtual_view: virtual_pixels(self.virtual_view.image(), &self.virtual_pixels),
            sunlight: &self.sunlight,
            by_picture: self.photometric.by_picture(),
            entropy_scale: T::of(weights.shadow_entropy / (width * height) as f64),
            altitude_scale: T::of(weights.consistency_altitude / agreeing),
            color_scale: T::of(weights.consistency_color / agreeing),
        };
        let outputs = self.by_view.data.par_chunks_mut(rows * 4 * width);
        outputs.zip(&mut self.stripes).enumerate().for_each(|(k, (by_view, stripe))| {
            T::dispatch(PixelsBackward { pass: &pass, first_row: k * rows, by_view, stripe });
        });
        gradient.appearance = [T::zero(); 15];
        for stripe in &self.stripes {
            for (sum, by) in gradient.appearance.iter_mut().zip(stripe.appearance) {
                *sum = *sum + by;
            }
        }
        if let Some(sun) = &shot.sun {
            self.by_sun.resize(sun.camera.width, sun.camera.height, 1);
            let stripes = &self.stripes;
            sum_windows(&mut self.by_sun, |k| stripes.get(k).map(|s| &s.by_sun));
        }
        if shot.virtual_view.is_some() {
            self.by_virtual.resize(width, height, 4);
            let stripes = &self.stripes;
            sum_windows(&mut self.by_virtual, |k| stripes.get(k).map(|s| &s.by_virtual));
        }
    }

    /// From the renders' derivatives to those by the splats.
    fn splats_backward(
        &mut self,
        gaussians: &Gaussians<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) {
        let n = gaussians.len();
        zeros(&mut self.by_shared, n);
        zeros(&mut self.by_feature, n);
        zeros(&mut self.by_altitude, n);
        let shared = &mut self.by_shared;
        let by_feature = &mut self.by_feature;
        pull_back(&mut self.view, VIEW, &self.by_view, shared, by_feature, watch);
        if shot.virtual_view.is_some() {
            pull_back(&mut self.virtual_view, VIRTUAL, &self.by_virtual, shared, by_feature, watch);
        }
        if shot.sun.is_some() {
            pull_back(&mut self.sun, SUN, &self.by_sun, shared, &mut self.by_altitude, watch);
        }
        gradient.splats.resize(n);
        self.prepared.parameter_gradients(gaussians, &self.by_shared, &mut gradient.splats);
        let opacity_scale = T::of(weights.opacity / n.max(1) as f64);
        let Gaussians { position, logit, f_dc, .. } = &mut gradient.splats;
        let rows = position.par_iter_mut().zip(logit).zip(f_dc).with_min_len(1024).enumerate();
        rows.for_each(|(i, ((position, logit), f_dc))| {
            let rank = self.prepared.rank(i);
            let by = self.by_feature[rank];
            *f_dc = std::array::from_fn(|c| by[c] * T::of(SH_C0));
            position[2] = position[2] + by[3] + self.by_altitude[rank][0];
            let o = self.prepared.opacity(rank);
            *logit = *logit + opacity_scale * o * (T::one() - o);
        });
    }
}

/// Makes a list of `n` zeros.
fn zeros<V: Clone + Default + Send + Sync>(values: &mut Vec<V>, n: usize) {
    values.resize(n, V::default());
    values.par_chunks_mut(1 << 14).for_each(|v| v.fill(V::default()));
}

/// Renders, timed.
fn draw<T: Lanewise, const C: usize>(
    raster: &mut Rasterizer<T, C>,
    part: &'static str,
    prepared: &Prepared<T>,
    features: &[[T; C]],
    camera: &FrameCamera<T>,
    background: [T; C],
    watch: &mut Stopwatch,
) {
    raster.project(prepared, camera);
    watch.lap(part, "projection");
    raster.bin(features);
    watch.lap(part, "binning");
    raster.draw(background);
    watch.lap(part, "forward");
}

/// Takes the derivatives by an image's pixels back to the splats, timed.
fn pull_back<T: Lanewise, const C: usize>(
    raster: &mut Rasterizer<T, C>,
    part: &'static str,
    by_pixel: &Layers<T>,
    shared: &mut [SplatGradient<T>],
    by_feature: &mut [[T; C]],
    watch: &mut Stopwatch,
) {
    raster.pull_back(by_pixel);
    watch.lap(part, "backward");
    raster.gather(shared, by_feature);
    watch.lap(part, "gathering");
}

/// The sun's altitudes, the first channel of its image, to be looked up.
fn sun_pixels<T>(image: &Layers<T>) -> Pixels<'_, T, 1> {
    let Layers { width, height, channels, .. } = *image;
    Pixels { width, height, stride: channels * width, data: image.data.as_chunks().0 }
}

/// A render whose features lie side by side in `data`, to be looked up.
fn virtual_pixels<'a, T>(image: &Layers<T>, data: &'a [[T; 4]]) -> Pixels<'a, T, 4> {
    let Layers { width, height, .. } = *image;
    Pixels { width, height, stride: width, data }
}

/// Puts the four features of every pixel of a render side by side.
fn side_by_side<T: Real>(image: &Layers<T>, pixels: &mut Vec<[T; 4]>) {
    pixels.resize(image.width * image.height, [T::zero(); 4]);
    pixels.par_chunks_mut(image.width).enumerate().for_each(|(row, pixels)| {
        let [r, g, b, z] = std::array::from_fn(|c| image.row(c, row));
        for (pixel, (((r, g), b), z)) in pixels.iter_mut().zip(r.iter().zip(g).zip(b).zip(z)) {
            *pixel = [*r, *g, *b, *z];
        }
    });
}

/// Sums the windows of the stripes; channels are apart again.
fn sum_windows<'a, T: Real, const C: usize>(
    sum: &mut Layers<T>,
    window: impl Fn(usize) -> Option<&'a Window<T, C>> + Sync,
) {
    let width = sum.width;
    sum.data.par_chunks_mut(width * C).enumerate().for_each(|(row, sum)| {
        sum.fill(T::zero());
        for pixels in (0..STRIPES).filter_map(|k| window(k)?.row(row)) {
            for (c, sum) in sum.chunks_exact_mut(width).enumerate() {
                for (sum, by) in sum.iter_mut().zip(pixels) {
                    *sum = *sum + by[c];
                }
            }
        }
    });
}

/// One where a pixel counts, else zero.
#[inline(always)]
fn counts<L: Lanes>(lanes: L, valid: &[bool], start: usize) -> Row<L> {
    let (zero, one) = (L::Number::of(0.0), L::Number::of(1.0));
    if valid.is_empty() {
        return Row::splat(lanes, one);
    }
    let mut out = [zero; LANES];
    for (o, v) in out.iter_mut().zip(&valid[start..]) {
        *o = if *v { one } else { zero };
    }
    Row::load(lanes, &out)
}

/// The forward pass over a stripe's pixels.
struct Compose<'a, T> {
    appearance: &'a Appearance<T>,
    shot: &'a Shot<'a, T>,
    view: &'a Layers<T>,
    sun: Pixels<'a, T, 1>,
    virtual_view: Pixels<'a, T, 4>,
    first_row: usize,
    picture: &'a mut [T],
    sunlight: &'a mut [T],
    stripe: &'a mut Stripe<T>,
}

impl<T: Lanewise> Kernel<T> for Compose<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { shot, view, sun, virtual_view, stripe, .. } = self;
        (stripe.entropy, stripe.agreement) = Default::default();
        let width = view.width;
        let appearance = Appearance { values: splat_each(lanes, self.appearance.values) };
        let [zero, one, rate, low, high] =
            splat_each(lanes, [0.0, 1.0, SHADOW_RATE_PER_M, ENTROPY_CLIP, 1.0 - ENTROPY_CLIP].map(T::of));
        let lane = Row::load(lanes, &std::array::from_fn::<_, LANES, _>(|i| T::of(i as f64)));
        let rows = self.picture.chunks_mut(3 * width).zip(self.sunlight.chunks_mut(2 * width));
        for (k, (picture, sunlight)) in rows.enumerate() {
            let row = self.first_row + k;
            let altitude = view.row(3, row);
            let (sunlight, slope) = sunlight.split_at_mut(width);
            // For now how much higher the sun sees something, negative.
            sunlight.fill(T::zero());
            if let Some(s) = &shot.sun {
                for (col, (delta, z)) in sunlight.iter_mut().zip(altitude).enumerate() {
                    if let Some(place) = s.lookup.place(col, row, *z, sun) {
                        let ([above], _) = place.values(sun);
                        *delta = (*z - above).min(T::zero());
                    }
                }
            }
            if let Some(v) = &shot.virtual_view {
                for (col, z) in altitude.iter().enumerate() {
                    if let Some(place) = v.lookup.place(col, row, *z, virtual_view) {
                        let ([.., other], _) = place.values(virtual_view);
                        if (*z - other).abs() < T::of(SAME_SURFACE_M) {
                            stripe.agreement.pixels += 1.0;
                        }
                    }
                }
            }
            let mut entropy = zero;
            for start in (0..width).step_by(L::WIDTH) {
                let s = (rate * Row::load_from(lanes, sunlight, start)).exp();
                if shot.sun.is_some() {
                    // Binary entropy, its logarithms' arguments clipped; only these follow the clip.
                    let clipped = s.max(low).min(high);
                    let (a, b) = (clipped.log2(), (one - clipped).log2());
                    let inside = Row::splat(lanes, T::of((width - start) as f64 - 1.0)).at_least(lane);
                    entropy += (s * a + (one - s) * b).keep(inside);
                    (b - a).store_to(slope, start);
                }
                s.store_to(sunlight, start);
                let mut rgb = [zero; 3];
                for c in 0..3 {
                    rgb[c] = Row::load_from(lanes, view.row(c, row), start);
                }
                let (lit, dim) = (appearance.sunlit(rgb), appearance.dimming(s));
                let counts = counts(lanes, shot.valid, row * width + start);
                for c in 0..3 {
                    (counts * lit[c] * dim[c]).store_to(&mut picture[c * width..(c + 1) * width], start);
                }
            }
            stripe.entropy -= entropy.sum().wide();
        }
    }
}

/// The backward pass over pixels: what every stripe reads.
struct PixelPass<'a, T> {
    appearance: &'a Appearance<T>,
    shot: &'a Shot<'a, T>,
    view: &'a Layers<T>,
    sun: Pixels<'a, T, 1>,
    virtual_view: Pixels<'a, T, 4>,
    sunlight: &'a Layers<T>,
    by_picture: &'a Layers<T>,
    entropy_scale: T,
    altitude_scale: T,
    color_scale: T,
}

/// The backward pass over a stripe's pixels.
struct PixelsBackward<'a, T> {
    pass: &'a PixelPass<'a, T>,
    first_row: usize,
    by_view: &'a mut [T],
    stripe: &'a mut Stripe<T>,
}

impl<T: Lanewise> Kernel<T> for PixelsBackward<'_, T> {
    #[inline(always)]
    fn run<L: Lanes<Number = T>>(self, lanes: L) {
        let Self { pass, first_row, by_view, stripe } = self;
        let PixelPass { shot, view, sunlight, .. } = *pass;
        let width = view.width;
        pass.open_windows(first_row..first_row + by_view.len() / (4 * width), stripe);
        let appearance = Appearance { values: splat_each(lanes, pass.appearance.values) };
        let [zero, entropy_scale] = splat_each(lanes, [T::zero(), pass.entropy_scale]);
        let mut by_values = [zero; 15];
        for (k, by_view) in by_view.chunks_mut(4 * width).enumerate() {
            let row = first_row + k;
            let (by_rgb, by_z) = by_view.split_at_mut(3 * width);
            for start in (0..width).step_by(L::WIDTH) {
                let counts = counts(lanes, shot.valid, row * width + start);
                let (mut rgb, mut by_pixel) = ([zero; 3], [zero; 3]);
                for c in 0..3 {
                    rgb[c] = Row::load_from(lanes, view.row(c, row), start);
                    by_pixel[c] = counts * Row::load_from(lanes, pass.by_picture.row(c, row), start);
                }
                let s = Row::load_from(lanes, sunlight.row(0, row), start);
                let (by, by_s) = appearance.backward(rgb, s, by_pixel, &mut by_values);
                for c in 0..3 {
                    by[c].store_to(&mut by_rgb[c * width..(c + 1) * width], start);
                }
                // For now the derivative by the share of sunlight.
                let by_entropy = Row::load_from(lanes, sunlight.row(1, row), start);
                entropy_scale.mul_add(by_entropy, by_s).store_to(by_z, start);
            }
            pass.scatter(row, by_rgb, by_z, stripe);
        }
        stripe.appearance = sum_each(by_values);
    }
}

impl<T: Real> PixelPass<'_, T> {
    /// Clears the rows that the stripe's pixels can scatter into.
    fn open_windows(&self, rows: Range<usize>, stripe: &mut Stripe<T>) {
        let altitudes = rows.clone().flat_map(|r| self.view.row(3, r));
        let range = altitudes.fold((T::infinity(), T::neg_infinity()), |(l, h), z| (l.min(*z), h.max(*z)));
        if let Some(s) = &self.shot.sun {
            let Pixels { width, height, .. } = self.sun;
            stripe.by_sun.open(width, s.lookup.rows(rows.clone(), range, height));
        }
        if let Some(v) = &self.shot.virtual_view {
            let Pixels { width, height, .. } = self.virtual_view;
            stripe.by_virtual.open(width, v.lookup.rows(rows, range, height));
        }
    }

    /// A row's derivatives through the sun's image and the virtual view; `by_z` holds those by the sunlight at first.
    #[inline(always)]
    fn scatter(&self, row: usize, by_rgb: &mut [T], by_z: &mut [T], stripe: &mut Stripe<T>) {
        let width = self.view.width;
        let features: [_; 4] = std::array::from_fn(|c| self.view.row(c, row));
        let sunlight = self.sunlight.row(0, row);
        for col in 0..width {
            let own = features.map(|f| f[col]);
            let (z, by_s) = (own[3], by_z[col]);
            by_z[col] = T::zero();
            if let Some(sun) = &self.shot.sun {
                by_z[col] = self.shade(&sun.lookup, (col, row), z, sunlight[col], by_s, &mut stripe.by_sun);
            }
            if let Some(v) = &self.shot.virtual_view {
                let by = self.agree(&v.lookup, (col, row), own, stripe);
                for c in 0..3 {
                    by_rgb[c * width + col] = by_rgb[c * width + col] + by[c];
                }
                by_z[col] = by_z[col] + by[3];
            }
        }
    }

    /// Derivative by the altitude through the share of sunlight; scatters that by the sun's image.
    #[inline(always)]
    fn shade(
        &self,
        lookup: &Lookup<T>,
        (col, row): (usize, usize),
        z: T,
        s: T,
        by_s: T,
        by_sun: &mut Window<T, 1>,
    ) -> T {
        let Some(place) = lookup.place(col, row, z, self.sun) else { return T::zero() };
        let ([above], [slope]) = place.values(self.sun);
        if z >= above {
            return T::zero();
        }
        let by_delta = T::of(SHADOW_RATE_PER_M) * s * by_s;
        place.scatter(by_sun, [-by_delta]);
        by_delta * (T::one() - lookup.by_altitude(slope))
    }

    /// Derivatives by a pixel's own features through the virtual view; scatters those by its image.
    #[inline(always)]
    fn agree(
        &self,
        lookup: &Lookup<T>,
        (col, row): (usize, usize),
        own: [T; 4],
        stripe: &mut Stripe<T>,
    ) -> [T; 4] {
        let zero = [T::zero(); 4];
        let Some(place) = lookup.place(col, row, own[3], self.virtual_view) else { return zero };
        let (others, slopes) = place.values(self.virtual_view);
        let difference: [T; 4] = std::array::from_fn(|c| own[c] - others[c]);
        let [r, g, b, z] = difference.map(T::abs);
        if z >= T::of(SAME_SURFACE_M) {
            return zero;
        }
        stripe.agreement.altitude += z.wide();
        stripe.agreement.color += (r + g + b).wide();
        let scales = [self.color_scale, self.color_scale, self.color_scale, self.altitude_scale];
        let sign = |d: T| if d == T::zero() { d } else { d.signum() };
        let mut by: [T; 4] = std::array::from_fn(|c| scales[c] * sign(difference[c]));
        place.scatter(&mut stripe.by_virtual, by.map(|by| -by));
        let by_slopes = (0..4).fold(T::zero(), |sum, c| sum + by[c] * lookup.by_altitude(slopes[c]));
        by[3] = by[3] - by_slopes;
        by
    }
}

#[cfg(test)]
#[path = "objective_tests.rs"]
mod tests;
