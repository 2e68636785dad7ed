//! One iteration's loss and its gradient: the view, the sun and a virtual camera rendered from one preparation.
//!
//! EOGS's model. The view is rendered with four features (colour, altitude). With the sun's image and the view's
//! radiometry they make the picture ([`ShadowModel`]), which is compared with the image ([`Photometric`]). A randomly
//! sheared camera must show the same ([`Consistency`]).

use crate::affine::AffineCamera;
use crate::simd::Real;
use crate::simd::SimdReal;
use crate::splat::appearance::Appearance;
use crate::splat::backend::stopwatch::Stopwatch;
use crate::splat::loss::consistency::{Consistency, Difference, Weights};
use crate::splat::loss::photometric::{Photometric, Similarity};
use crate::splat::raster::{FrameCamera, Image, Rasterizer, SortedSplats, SplatGradient};
use crate::splat::shadow::{ByPicture, Scene, ShadowModel};
use crate::splat::shear_warp::ShearWarp;
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_gradient};
use rayon::prelude::*;

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
pub struct ShearedCamera<T> {
    camera: FrameCamera<T>,
    lookup: ShearWarp<T>,
}

impl<T: Real> ShearedCamera<T> {
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
            lookup: ShearWarp { shear: shear.map(T::from_f64), origin: [T::from_f64(col), T::from_f64(row)] },
        }
    }

    /// A virtual view of the view's own size, pivoting at the site's origin.
    #[must_use]
    pub fn virtual_view(view: &AffineCamera, size: (usize, usize), shear: [f64; 2]) -> Self {
        Self {
            camera: FrameCamera::new(&view.sheared(shear), size.0, size.1),
            lookup: ShearWarp { shear: shear.map(T::from_f64), origin: [T::zero(); 2] },
        }
    }
}

/// What an iteration looks at.
pub struct StepInput<'a, T> {
    /// The view's camera.
    pub camera: FrameCamera<T>,
    /// The view's image, colours in [0, 1]; zero where masked.
    pub truth: &'a Image<T>,
    /// Pixels that count, row by row; empty when all do.
    pub valid: &'a [bool],
    /// The sun's image, if shadows are modelled.
    pub sun: Option<ShearedCamera<T>>,
    /// The virtual camera, if consistency is asked for.
    pub virtual_view: Option<ShearedCamera<T>>,
    /// Colour behind the splats.
    pub background: [T; 3],
    /// Altitude behind the splats, metres above the site's origin.
    pub floor: T,
}

impl<T: Real> StepInput<'_, T> {
    /// Colours and altitude behind the splats.
    fn behind(&self) -> [T; 4] {
        let [r, g, b] = self.background;
        [r, g, b, self.floor]
    }
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
    pub splats: Splats<T>,
    /// By the view's radiometry.
    pub appearance: [T; 15],
}

/// Computes losses and gradients; keeps every buffer between iterations.
#[derive(Default)]
pub struct Objective<T: Real> {
    prepared: SortedSplats<T>,
    view: Rasterizer<T, 4>,
    sun: Rasterizer<T, 1>,
    virtual_view: Rasterizer<T, 4>,
    features: Vec<[T; 4]>,
    altitudes: Vec<[T; 1]>,
    by_feature: Vec<[T; 4]>,
    by_altitude: Vec<[T; 1]>,
    by_shared: Vec<SplatGradient<T>>,
    shading: ShadowModel<T>,
    photometric: Photometric<T>,
    consistency: Consistency<T>,
}

impl<T: SimdReal> Objective<T> {
    /// The loss of one shot; its gradient goes to `gradient`, the time that stages took to `watch`.
    pub fn evaluate(
        &mut self,
        gaussians: &Splats<T>,
        appearance: &Appearance<T>,
        shot: &StepInput<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses {
        self.show(gaussians, appearance, shot, watch);
        let (picture, _) = self.photometric.compare(self.shading.picture(), shot.truth);
        watch.lap("pixels", "SSIM and L1");
        let consistency =
            Weights { altitude: weights.consistency_altitude, color: weights.consistency_color };
        let difference = match &shot.virtual_view {
            Some(v) => {
                draw(
                    &mut self.virtual_view,
                    VIRTUAL,
                    &self.prepared,
                    &self.features,
                    &v.camera,
                    shot.behind(),
                    watch,
                );
                let others = self.virtual_view.image();
                let difference = self.consistency.compare(self.view.image(), others, &v.lookup, consistency);
                watch.lap(VIRTUAL, "consistency");
                difference
            }
            None => Difference::default(),
        };
        let by = ByPicture {
            picture: self.photometric.by_picture(),
            entropy: weights.shadow_entropy,
            view: shot.virtual_view.as_ref().map(|_| self.consistency.by_view()),
        };
        let scene = scene(&self.view, &self.sun, appearance, shot);
        gradient.appearance = self.shading.backward(scene, by);
        watch.lap("pixels", "picture backward");
        self.splats_backward(gaussians, shot, weights, gradient, watch);

        let mut losses = Losses {
            total: 0.0,
            picture,
            opacity: self.prepared.mean_opacity(),
            consistency_altitude: difference.altitude,
            consistency_color: difference.color,
            shadow_entropy: self.shading.entropy(),
        };
        losses.total = picture.loss()
            + weights.opacity * losses.opacity
            + weights.consistency_altitude * losses.consistency_altitude
            + weights.consistency_color * losses.consistency_color
            + weights.shadow_entropy * losses.shadow_entropy;
        watch.lap("splats", "parameters backward");
        losses
    }

    /// Makes the picture of one shot, whose `truth` and `virtual_view` do not matter.
    pub fn show(
        &mut self,
        gaussians: &Splats<T>,
        appearance: &Appearance<T>,
        shot: &StepInput<T>,
        watch: &mut Stopwatch,
    ) {
        self.prepare(gaussians);
        watch.lap("splats", "order and covariances");
        let prepared = &self.prepared;
        draw(&mut self.view, VIEW, prepared, &self.features, &shot.camera, shot.behind(), watch);
        if let Some(sun) = &shot.sun {
            draw(&mut self.sun, SUN, prepared, &self.altitudes, &sun.camera, [shot.floor], watch);
        }
        self.shading.show(scene(&self.view, &self.sun, appearance, shot));
        watch.lap("pixels", "picture");
    }

    /// The view's render of the last evaluation: colours, altitude, transmittance.
    #[must_use]
    pub fn view(&self) -> &Image<T> {
        self.view.image()
    }

    /// The picture of the last evaluation, three channels.
    #[must_use]
    pub fn picture(&self) -> &Image<T> {
        self.shading.picture()
    }

    /// The share of sunlight in the last evaluation's picture, the first channel.
    #[must_use]
    pub fn sunlight(&self) -> &Image<T> {
        self.shading.sunlight()
    }

    /// The derivative by a splat's image position, if the last evaluation's view saw it.
    #[must_use]
    pub fn seen(&self, splat: usize) -> Option<[T; 2]> {
        self.view.seen(self.prepared.rank(splat))
    }

    fn prepare(&mut self, gaussians: &Splats<T>) {
        self.prepared.update(gaussians);
        let order = self.prepared.order();
        self.features.resize(order.len(), [T::zero(); 4]);
        self.altitudes.resize(order.len(), [T::zero(); 1]);
        let features = self.features.par_iter_mut().zip(&mut self.altitudes).zip(order);
        features.with_min_len(1024).for_each(|((feature, altitude), &i)| {
            let ([r, g, b], z) =
                (color_from_f_dc(gaussians.f_dc[i as usize]), gaussians.position[i as usize][2]);
            *feature = [r, g, b, z];
            *altitude = [z];
        });
    }

    /// From the renders' derivatives to those by the splats.
    fn splats_backward(
        &mut self,
        gaussians: &Splats<T>,
        shot: &StepInput<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) {
        let n = gaussians.len();
        let opacity_scale = T::from_f64(weights.opacity / n.max(1) as f64);
        self.by_shared.resize(n, SplatGradient::default());
        self.by_shared.par_iter_mut().with_min_len(1024).enumerate().for_each(|(rank, by)| {
            let o = self.prepared.opacity(rank);
            *by = SplatGradient { log_opacity: opacity_scale * o, ..SplatGradient::default() };
        });
        zeros(&mut self.by_feature, n);
        zeros(&mut self.by_altitude, n);
        let shared = &mut self.by_shared;
        let by_feature = &mut self.by_feature;
        backward(&mut self.view, VIEW, self.shading.by_view(), shared, by_feature, watch);
        if shot.virtual_view.is_some() {
            backward(
                &mut self.virtual_view,
                VIRTUAL,
                self.consistency.by_virtual(),
                shared,
                by_feature,
                watch,
            );
        }
        if shot.sun.is_some() {
            backward(&mut self.sun, SUN, self.shading.by_sun(), shared, &mut self.by_altitude, watch);
        }
        gradient.splats.resize(n);
        self.prepared.parameter_gradients(gaussians, &self.by_shared, &mut gradient.splats);
        let Splats { position, f_dc, .. } = &mut gradient.splats;
        let rows = position.par_iter_mut().zip(f_dc).with_min_len(1024).enumerate();
        rows.for_each(|(i, (position, f_dc))| {
            let rank = self.prepared.rank(i);
            let by = self.by_feature[rank];
            *f_dc = f_dc_gradient([by[0], by[1], by[2]]);
            position[2] = position[2] + by[3] + self.by_altitude[rank][0];
        });
    }
}

/// Makes a list of `n` zeros.
fn zeros<V: Clone + Default + Send + Sync>(values: &mut Vec<V>, n: usize) {
    values.resize(n, V::default());
    values.par_chunks_mut(1 << 14).for_each(|v| v.fill(V::default()));
}

/// What the picture of a shot is made of, once it is rendered.
fn scene<'a, T: SimdReal>(
    view: &'a Rasterizer<T, 4>,
    sun: &'a Rasterizer<T, 1>,
    appearance: &'a Appearance<T>,
    shot: &StepInput<'a, T>,
) -> Scene<'a, T> {
    let sun = shot.sun.map(|s| (s.lookup, sun.image()));
    Scene { appearance, view: view.image(), sun, valid: shot.valid }
}

/// Renders, timed.
fn draw<T: SimdReal, const C: usize>(
    raster: &mut Rasterizer<T, C>,
    part: &'static str,
    prepared: &SortedSplats<T>,
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
fn backward<T: SimdReal, const C: usize>(
    raster: &mut Rasterizer<T, C>,
    part: &'static str,
    by_pixel: &Image<T>,
    shared: &mut [SplatGradient<T>],
    by_feature: &mut [[T; C]],
    watch: &mut Stopwatch,
) {
    raster.pixels_backward(by_pixel);
    watch.lap(part, "backward");
    raster.gather(shared, by_feature);
    watch.lap(part, "gathering");
}

#[cfg(test)]
#[path = "objective_tests.rs"]
mod tests;
