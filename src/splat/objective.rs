//! One iteration's loss and its gradient: the view, the sun and a virtual camera rendered from one preparation.
//!
//! EOGS's model. The view is rendered with four features (colour, altitude). From each pixel's altitude the sun's
//! altitude image is looked up: where it lies `Δ` metres higher, the share of sunlight is `exp(ρ min(-Δ, 0))`. The
//! view's radiometry and that share make the picture, which is compared with the image. A randomly sheared camera
//! must show the same altitude and colour where it sees the same surface.

use super::appearance::Appearance;
use super::gaussians::{Gaussians, SH_C0, sigmoid};
use super::lanes::Lanewise;
use super::lookup::Lookup;
use super::raster::{FrameCamera, Layers, Prepared, Rasterizer, SplatGradient};
use super::real::Real;
use super::ssim::{Photometric, Rows, Similarity};
use crate::affine::AffineCamera;
use rayon::prelude::*;

/// Extinction of sunlight per metre that the sun sees something higher (EOGS: fixed).
const SHADOW_RATE_PER_M: f64 = 0.4;
/// Altitudes that differ by less are the same surface to the virtual camera, metres (EOGS).
const SAME_SURFACE_M: f64 = 0.30;
/// Shares of sunlight nearer to 0 or 1 have no entropy (EOGS).
const ENTROPY_CLIP: f64 = 0.05;
/// Runs of rows that scatter into buffers of their own; fixed, so that sums do not depend on the threads.
const STRIPES: usize = 4;

/// What the loss weighs (EOGS's names in brackets).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
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
    features: Vec<[T; 4]>,
    altitudes: Vec<[T; 1]>,
    by_feature: Vec<[T; 4]>,
    by_altitude: Vec<[T; 1]>,
    by_shared: Vec<SplatGradient<T>>,
    sunlight: Layers<T>,
    picture: Layers<T>,
    photometric: Photometric<T>,
    by_view: Layers<T>,
    stripes: Vec<Stripe<T>>,
}

/// What a run of rows scatters, and sums.
#[derive(Default)]
struct Stripe<T> {
    by_sun: Layers<T>,
    by_virtual: Layers<T>,
    appearance: [T; 15],
}

/// Sums over pixels that see the same surface in the virtual view.
#[derive(Clone, Copy, Default)]
struct Agreement {
    pixels: f64,
    altitude: f64,
    color: f64,
}

impl<T: Lanewise + Rows> Objective<T> {
    /// The loss of one shot; its gradient goes to `gradient`.
    pub fn evaluate(
        &mut self,
        gaussians: &Gaussians<T>,
        appearance: &Appearance<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
    ) -> Losses {
        self.prepare(gaussians);
        let [r, g, b] = shot.background;
        let background = [r, g, b, shot.floor];
        self.view.render(&self.prepared, &self.features, &shot.camera, background);
        if let Some(sun) = &shot.sun {
            self.sun.render(&self.prepared, &self.altitudes, &sun.camera, [shot.floor]);
        }
        if let Some(virtual_view) = &shot.virtual_view {
            self.virtual_view.render(&self.prepared, &self.features, &virtual_view.camera, background);
        }

        let entropy = self.compose(appearance, shot);
        let agreement = self.agreement(shot);
        let (similarity, _) = self.photometric.compare(&self.picture, shot.truth);
        self.pixels_backward(appearance, shot, weights, agreement);
        self.splats_backward(gaussians, shot, weights, gradient);

        let pixels = (shot.camera.width * shot.camera.height) as f64;
        let n = agreement.pixels.max(1.0);
        let mut losses = Losses {
            total: 0.0,
            picture: similarity,
            opacity: gaussians.logit.iter().map(|l| sigmoid(*l).wide()).sum::<f64>()
                / gaussians.len().max(1) as f64,
            consistency_altitude: agreement.altitude / n,
            consistency_color: agreement.color / n,
            shadow_entropy: entropy / pixels,
        };
        losses.total = similarity.loss()
            + weights.opacity * losses.opacity
            + weights.consistency_altitude * losses.consistency_altitude
            + weights.consistency_color * losses.consistency_color
            + weights.shadow_entropy * losses.shadow_entropy;
        losses
    }

    /// The picture of the last evaluation, three channels.
    #[must_use]
    pub fn picture(&self) -> &Layers<T> {
        &self.picture
    }

    /// Visits, for every splat the last evaluation's view saw, its index and the derivative by its image position.
    pub fn for_each_seen(&self, mut visit: impl FnMut(usize, [T; 2])) {
        self.view.for_each_seen(|rank, g| visit(self.prepared.order()[rank] as usize, g));
    }

    fn prepare(&mut self, gaussians: &Gaussians<T>) {
        self.prepared.update(gaussians);
        let order = self.prepared.order();
        let color = |v: T| v * T::of(SH_C0) + T::of(0.5);
        self.features.clear();
        self.features.par_extend(order.par_iter().with_min_len(1024).map(|&i| {
            let f = gaussians.f_dc[i as usize];
            [color(f[0]), color(f[1]), color(f[2]), gaussians.position[i as usize][2]]
        }));
        self.altitudes.clear();
        self.altitudes.extend(self.features.iter().map(|f| [f[3]]));
    }

    /// Makes the picture from the renders; returns the sum of the sunlight's entropy.
    fn compose(&mut self, appearance: &Appearance<T>, shot: &Shot<T>) -> f64 {
        let (width, height) = (shot.camera.width, shot.camera.height);
        self.picture.resize(width, height, 3);
        self.sunlight.resize(width, height, 1);
        let view = self.view.image();
        let sun = shot.sun.map(|s| (s.lookup, self.sun.image()));
        let rows = self.picture.data.par_chunks_mut(3 * width).zip(self.sunlight.data.par_chunks_mut(width));
        let entropies: Vec<f64> = rows
            .enumerate()
            .map(|(row, (picture, sunlight))| {
                let [red, green, blue, altitude] = std::array::from_fn(|c| view.row(c, row));
                let mut sum = T::zero();
                for col in 0..width {
                    let s = match &sun {
                        Some((lookup, image)) => {
                            let place = lookup.place(col, row, altitude[col], image);
                            let delta = place.map_or(T::zero(), |p| altitude[col] - p.value(image, 0).0);
                            let s = (T::of(SHADOW_RATE_PER_M) * delta.min(T::zero())).exp_lane();
                            sum = sum + entropy(s).0;
                            s
                        }
                        None => T::one(),
                    };
                    sunlight[col] = s;
                    let rgb = [red[col], green[col], blue[col]];
                    let (lit, dim) = (appearance.sunlit(rgb), appearance.dimming(s));
                    let counts = shot.valid.get(row * width + col).copied().unwrap_or(true);
                    for c in 0..3 {
                        picture[c * width + col] = if counts { lit[c] * dim[c] } else { T::zero() };
                    }
                }
                sum.wide()
            })
            .collect();
        entropies.iter().sum()
    }

    /// Compares the view with the virtual one where both see the same surface.
    fn agreement(&self, shot: &Shot<T>) -> Agreement {
        let Some(virtual_view) = &shot.virtual_view else { return Agreement::default() };
        let (view, image) = (self.view.image(), self.virtual_view.image());
        let rows: Vec<Agreement> = (0..view.height)
            .into_par_iter()
            .map(|row| {
                let mut sum = Agreement::default();
                for (col, z) in view.row(3, row).iter().enumerate() {
                    let Some(place) = virtual_view.lookup.place(col, row, *z, image) else { continue };
                    let dz = (*z - place.value(image, 3).0).abs();
                    if dz < T::of(SAME_SURFACE_M) {
                        sum.pixels += 1.0;
                        sum.altitude += dz.wide();
                        for c in 0..3 {
                            sum.color += (view.at(c, col, row) - place.value(image, c).0).abs().wide();
                        }
                    }
                }
                sum
            })
            .collect();
        rows.iter().fold(Agreement::default(), |a, b| Agreement {
            pixels: a.pixels + b.pixels,
            altitude: a.altitude + b.altitude,
            color: a.color + b.color,
        })
    }

    /// From the picture's derivatives to those by the three renders.
    fn pixels_backward(
        &mut self,
        appearance: &Appearance<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        agreement: Agreement,
    ) {
        let (width, height) = (shot.camera.width, shot.camera.height);
        let rows_per_stripe = height.div_ceil(STRIPES);
        self.by_view.resize(width, height, 4);
        self.stripes.resize_with(STRIPES, Stripe::default);
        let pass = PixelPass {
            appearance,
            shot,
            view: self.view.image(),
            sun: self.sun.image(),
            virtual_view: self.virtual_view.image(),
            sunlight: &self.sunlight,
            by_picture: self.photometric.by_picture(),
            entropy_scale: T::of(weights.shadow_entropy / (width * height) as f64),
            altitude_scale: T::of(weights.consistency_altitude / agreement.pixels.max(1.0)),
            color_scale: T::of(weights.consistency_color / agreement.pixels.max(1.0)),
        };
        let outputs = self.by_view.data.par_chunks_mut(rows_per_stripe * 4 * width);
        outputs.zip(&mut self.stripes).enumerate().for_each(|(k, (by_view, stripe))| {
            stripe.appearance = [T::zero(); 15];
            if let Some(sun) = &shot.sun {
                stripe.by_sun.clear(sun.camera.width, sun.camera.height, 1);
            }
            if shot.virtual_view.is_some() {
                stripe.by_virtual.clear(width, height, 4);
            }
            for (r, by_view) in by_view.chunks_mut(4 * width).enumerate() {
                pass.row(k * rows_per_stripe + r, by_view, stripe);
            }
        });
        // A small image may leave the last stripes without a row.
        for stripe in self.stripes.iter_mut().skip(height.div_ceil(rows_per_stripe)) {
            *stripe = Stripe::default();
        }
        let (first, rest) = self.stripes.split_at_mut(1);
        for other in rest {
            sum_into(&mut first[0].by_sun.data, &other.by_sun.data);
            sum_into(&mut first[0].by_virtual.data, &other.by_virtual.data);
            for (a, b) in first[0].appearance.iter_mut().zip(other.appearance) {
                *a = *a + b;
            }
        }
    }

    /// From the renders' derivatives to those by the splats.
    fn splats_backward(
        &mut self,
        gaussians: &Gaussians<T>,
        shot: &Shot<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
    ) {
        let n = gaussians.len();
        self.by_shared.clear();
        self.by_shared.resize(n, SplatGradient::default());
        self.by_feature.clear();
        self.by_feature.resize(n, [T::zero(); 4]);
        self.by_altitude.clear();
        self.by_altitude.resize(n, [T::zero(); 1]);
        let stripe = &self.stripes[0];
        gradient.appearance = stripe.appearance;
        let shared = &mut self.by_shared;
        self.view.backward(&shot.camera, &self.by_view, shared, &mut self.by_feature);
        if let Some(v) = &shot.virtual_view {
            let by_feature = &mut self.by_feature;
            self.virtual_view.backward(&v.camera, &stripe.by_virtual, shared, by_feature);
        }
        if let Some(sun) = &shot.sun {
            self.sun.backward(&sun.camera, &stripe.by_sun, shared, &mut self.by_altitude);
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
            let o = sigmoid(gaussians.logit[i]);
            *logit = *logit + opacity_scale * o * (T::one() - o);
        });
    }
}

fn sum_into<T: Real>(sum: &mut [T], other: &[T]) {
    sum.par_chunks_mut(1 << 14).zip(other.par_chunks(1 << 14)).for_each(|(a, b)| {
        for (a, b) in a.iter_mut().zip(b) {
            *a = *a + *b;
        }
    });
}

/// Binary entropy of a share of sunlight with the logarithms' arguments clipped, and its derivative.
fn entropy<T: Real>(s: T) -> (T, T) {
    let (one, low) = (T::one(), T::of(ENTROPY_CLIP));
    let c = s.max(low).min(one - low);
    let (a, b) = (c.log2(), (one - c).log2());
    let inside = if c == s { one } else { T::zero() };
    let by_log = inside * T::of(std::f64::consts::LOG2_E) * (s / c - (one - s) / (one - c));
    (-(s * a + (one - s) * b), -(a - b + by_log))
}

/// The backward pass over pixels: what a row reads.
struct PixelPass<'a, T> {
    appearance: &'a Appearance<T>,
    shot: &'a Shot<'a, T>,
    view: &'a Layers<T>,
    sun: &'a Layers<T>,
    virtual_view: &'a Layers<T>,
    sunlight: &'a Layers<T>,
    by_picture: &'a Layers<T>,
    entropy_scale: T,
    altitude_scale: T,
    color_scale: T,
}

impl<T: Real> PixelPass<'_, T> {
    fn row(&self, row: usize, by_view: &mut [T], stripe: &mut Stripe<T>) {
        let width = self.view.width;
        let [red, green, blue, altitude] = std::array::from_fn(|c| self.view.row(c, row));
        let by_picture: [&[T]; 3] = std::array::from_fn(|c| self.by_picture.row(c, row));
        let sunlight = self.sunlight.row(0, row);
        for col in 0..width {
            let rgb = [red[col], green[col], blue[col]];
            let z = altitude[col];
            let counts = self.shot.valid.get(row * width + col).copied().unwrap_or(true);
            let (mut by_rgb, mut by_sunlight, mut by_z) = ([T::zero(); 3], T::zero(), T::zero());
            let s = sunlight[col];
            if counts {
                let by_pixel = by_picture.map(|p| p[col]);
                (by_rgb, by_sunlight) = self.appearance.backward(rgb, s, by_pixel, &mut stripe.appearance);
            }
            if let Some(sun) = &self.shot.sun {
                let by_s = by_sunlight + self.entropy_scale * entropy(s).1;
                by_z = by_z + self.shade(&sun.lookup, (col, row), z, s, by_s, &mut stripe.by_sun);
            }
            if let Some(v) = &self.shot.virtual_view {
                let by = self.agree(&v.lookup, (col, row), rgb, z, &mut stripe.by_virtual);
                for c in 0..3 {
                    by_rgb[c] = by_rgb[c] + by[c];
                }
                by_z = by_z + by[3];
            }
            for (c, by) in [by_rgb[0], by_rgb[1], by_rgb[2], by_z].into_iter().enumerate() {
                by_view[c * width + col] = by;
            }
        }
    }

    /// Derivative by the altitude through the share of sunlight; scatters that by the sun's image.
    fn shade(
        &self,
        lookup: &Lookup<T>,
        (col, row): (usize, usize),
        z: T,
        s: T,
        by_s: T,
        by_sun: &mut Layers<T>,
    ) -> T {
        let Some(place) = lookup.place(col, row, z, self.sun) else { return T::zero() };
        let (above, slope) = place.value(self.sun, 0);
        if z >= above {
            return T::zero();
        }
        let by_delta = T::of(SHADOW_RATE_PER_M) * s * by_s;
        place.scatter(by_sun, 0, -by_delta);
        by_delta * (T::one() - lookup.by_altitude(slope))
    }

    /// Derivatives by colour and altitude through the virtual view; scatters those by its image.
    fn agree(
        &self,
        lookup: &Lookup<T>,
        (col, row): (usize, usize),
        rgb: [T; 3],
        z: T,
        by_virtual: &mut Layers<T>,
    ) -> [T; 4] {
        let zero = [T::zero(); 4];
        let Some(place) = lookup.place(col, row, z, self.virtual_view) else { return zero };
        let (other, slope) = place.value(self.virtual_view, 3);
        if (z - other).abs() >= T::of(SAME_SURFACE_M) {
            return zero;
        }
        let sign = |d: T| if d == T::zero() { d } else { d.signum() };
        let by_z = self.altitude_scale * sign(z - other);
        place.scatter(by_virtual, 3, -by_z);
        let mut by = zero;
        by[3] = by_z * (T::one() - lookup.by_altitude(slope));
        for c in 0..3 {
            let (other, slope) = place.value(self.virtual_view, c);
            by[c] = self.color_scale * sign(rgb[c] - other);
            place.scatter(by_virtual, c, -by[c]);
            by[3] = by[3] - by[c] * lookup.by_altitude(slope);
        }
        by
    }
}

#[cfg(test)]
#[path = "objective_tests.rs"]
mod tests;
