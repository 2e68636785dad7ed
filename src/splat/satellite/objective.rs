//! The loss of one iteration and its gradient (EOGS): renders of the view, the sun's image and a virtual view, from splats
//! that are sorted once.
//!
//! The view is rendered with four features: linear colour and altitude. A render of the altitudes from the sun gives each
//! pixel's share of sunlight ([`ShadowModel`]). The view's colour model ([`AppearanceModel`]) computes the picture from
//! colours and sunlight. The loss terms ([`TermSet`]) compare picture, renders and splats with their targets.

use crate::camera::QuadraticKernel;
use crate::simd::{Real, SimdReal};
use crate::splat::anchored::Anchoring;
use crate::splat::appearance::{
    AppearanceModel, ColorInput, ModelParameters, ParameterGradient, ShadingGradient, ShadingInput, SplatSun,
};
use crate::splat::loss::{LossWeights, Losses, Rendered, TermSet};
use crate::splat::primitive::PrimitiveKind;
use crate::splat::raster::{
    FrameCamera, Image, Renderer, Scaled, SortedSplats, SplatGradient, channel, renderer,
};
use crate::splat::shadow::ShadowModel;
use crate::splat::sheared_camera::{ShearedCamera, SunView};
use crate::splat::splats::{GROUP_INFO, Splats};
use crate::splat::stopwatch::Stopwatch;
use crate::splat::sun_visibility::sun_visibility;
use rayon::prelude::*;

/// Names of the renders in the table of times.
const VIEW: &str = "view";
const SUN: &str = "sun image";
const VIRTUAL: &str = "virtual view";

/// Parameter groups whose gradient rasteriser and colour model write; that of the others starts at zero for the terms to add
/// to.
const WRITTEN_GROUPS: [&str; 5] = ["position", "f_dc", "opacity_logit", "log_scale", "rotation"];

/// What one iteration renders and compares.
pub struct SatelliteStep<'a, T> {
    /// The view's camera.
    pub camera: FrameCamera<QuadraticKernel<T>>,
    /// The view's image: linear colours in [0, 1], zero where masked.
    pub target: &'a Image<T>,
    /// Which pixels are valid, row by row; empty if all are.
    pub valid: &'a [bool],
    /// Visibility of each pixel, 0 to 1, one channel; none if all are visible.
    pub visibility: Option<&'a Image<T>>,
    /// Place of the crop that the perceptual term compares; none without the term.
    pub crop: Option<[f64; 2]>,
    /// The sun; none without shadows.
    pub sun: Option<SunView<T>>,
    /// Camera of the virtual view; none without the consistency loss.
    pub virtual_view: Option<ShearedCamera<T>>,
    /// Linear colour behind the splats.
    pub background: [T; 3],
    /// Altitude behind the splats, metres above the site's origin.
    pub floor: T,
    /// The splats that are anchored to others.
    pub anchored: &'a [Anchoring],
}

impl<T: Real> SatelliteStep<'_, T> {
    /// Colour and altitude behind the splats.
    fn background_features(&self) -> [T; 4] {
        let [r, g, b] = self.background;
        [r, g, b, self.floor]
    }
}

/// Derivatives of the loss with respect to all trained parameters.
#[derive(Clone, Debug, Default)]
pub struct Gradient<T> {
    /// With respect to the splats' parameters.
    pub splats: Splats<T>,
    /// With respect to the parameters of the view's colour model.
    pub appearance: Vec<T>,
    /// With respect to the parameters of the colour model that all views share.
    pub shared: Vec<T>,
}

/// A rasteriser of satellite views.
type BoxedRenderer<T, const C: usize> = Box<dyn Renderer<T, C, QuadraticKernel<T>>>;

/// Computes losses and gradients; keeps all buffers between iterations.
pub struct SatelliteObjective<T: Real> {
    sorted: SortedSplats<T>,
    view: BoxedRenderer<T, 4>,
    sun: BoxedRenderer<T, 1>,
    virtual_view: BoxedRenderer<T, 4>,
    colors: Vec<[T; 3]>,
    features: Vec<[T; 4]>,
    altitudes: Vec<[T; 1]>,
    by_colors: Vec<[T; 3]>,
    by_feature: Vec<[T; 4]>,
    by_altitude: Vec<[T; 1]>,
    by_sorted: Vec<SplatGradient<T>>,
    /// Derivatives by the normals of discs; empty for ellipsoids.
    by_normal: Vec<[T; 3]>,
    primitive: PrimitiveKind,
    shadows: ShadowModel<T>,
    /// Visibility of the sun from each splat, 0 to 1; empty if the colour model does not separate light and colours.
    sun_visibility: Vec<T>,
    appearance: Box<dyn AppearanceModel<T>>,
    picture: Image<T>,
    by_view: Image<T>,
    by_sunlight: Image<T>,
    terms: TermSet<T>,
}

impl<T: SimdReal> SatelliteObjective<T> {
    /// The objective for splats of this kind with this colour model and these loss terms.
    #[must_use]
    pub fn new(primitive: PrimitiveKind, appearance: Box<dyn AppearanceModel<T>>, terms: TermSet<T>) -> Self {
        Self {
            primitive,
            sorted: SortedSplats::of(primitive),
            view: renderer(primitive),
            sun: renderer(primitive),
            virtual_view: renderer(primitive),
            colors: Vec::new(),
            features: Vec::new(),
            altitudes: Vec::new(),
            by_colors: Vec::new(),
            by_feature: Vec::new(),
            by_altitude: Vec::new(),
            by_sorted: Vec::new(),
            by_normal: Vec::new(),
            shadows: ShadowModel::default(),
            sun_visibility: Vec::new(),
            appearance,
            picture: Image::default(),
            by_view: Image::default(),
            by_sunlight: Image::default(),
            terms,
        }
    }

    /// Computes the loss of one iteration; writes the gradient to `gradient` and adds the time of each part to `watch`.
    /// `appearance` holds the parameters of the colour model.
    pub fn evaluate(
        &mut self,
        splats: &Splats<T>,
        appearance: ModelParameters<T>,
        input: &SatelliteStep<T>,
        weights: &LossWeights,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses {
        self.forward(splats, appearance, input, watch);
        if let Some(v) = &input.virtual_view {
            let background = input.background_features();
            render(
                self.virtual_view.as_mut(),
                VIRTUAL,
                &self.sorted,
                &self.features,
                &v.camera,
                background,
                watch,
            );
        }
        let rendered = Rendered {
            anchored: input.anchored,
            priors: None,
            visibility: input.visibility,
            crop: input.crop,
            light: self.appearance.light().map(|light| (light, &self.sun_visibility[..])),
            view: self.view.image(),
            discs: None,
            picture: &self.picture,
            sunlight: input.sun.is_some().then_some(self.shadows.sunlight()),
            virtual_view: input.virtual_view.as_ref().map(|v| (self.virtual_view.image(), &v.warp)),
            target: input.target,
            splats,
            mean_opacity: self.sorted.mean_opacity(),
        };
        let losses = self.terms.evaluate(&rendered, weights, input.valid, watch);
        self.pixels_backward(appearance, input, gradient, watch);
        self.splats_backward(splats, appearance, input, gradient, watch);
        losses
    }

    /// Renders the picture of one iteration without loss and gradient; target and virtual view of `input` are ignored.
    pub fn forward(
        &mut self,
        splats: &Splats<T>,
        appearance: ModelParameters<T>,
        input: &SatelliteStep<T>,
        watch: &mut Stopwatch,
    ) {
        self.sorted.update(splats);
        let order = self.sorted.order();
        self.altitudes.resize(order.len(), [T::zero(); 1]);
        let altitudes = self.altitudes.par_iter_mut().zip(order).with_min_len(1024);
        altitudes.for_each(|(altitude, &i)| *altitude = [splats.position[i as usize][2]]);
        watch.lap("splats", "order and covariances");
        if let Some(sun) = &input.sun {
            let camera = &sun.image.camera;
            render(self.sun.as_mut(), SUN, &self.sorted, &self.altitudes, camera, [input.floor], watch);
            if self.appearance.has_shaded_splats() {
                sun_visibility(splats, &sun.image, self.sun.image(), &mut self.sun_visibility);
            }
        }
        self.color(splats, appearance, input, watch);
        render(
            self.view.as_mut(),
            VIEW,
            &self.sorted,
            &self.features,
            &input.camera,
            input.background_features(),
            watch,
        );
        let (view, sun) = (self.view.image(), input.sun.map(|s| (s.image.warp, self.sun.image())));
        self.shadows.forward(view, sun);
        let shading = ShadingInput { render: view, sunlight: self.shadows.sunlight(), valid: input.valid };
        self.appearance.shade(appearance.view, shading, &mut self.picture);
        watch.lap("pixels", "picture");
    }

    /// The view's render of the last forward pass: colour, altitude, transmittance
    /// ([`channel`]).
    #[must_use]
    pub fn view(&self) -> &Image<T> {
        self.view.image()
    }

    /// The picture of the last forward pass: linear colours, three channels.
    #[must_use]
    pub fn picture(&self) -> &Image<T> {
        &self.picture
    }

    /// The share of sunlight of the last forward pass, 0 to 1, one channel.
    #[must_use]
    pub fn sunlight(&self) -> &Image<T> {
        self.shadows.sunlight()
    }

    /// Derivative of the loss with respect to a splat's 2-D mean (column, row) in the view, per pixel, as the last
    /// evaluation computed it; none if the splat was not visible.
    #[must_use]
    pub fn mean2d_gradient(&self, splat: usize) -> Option<[T; 2]> {
        self.view.mean2d_gradient(self.sorted.rank(splat))
    }

    /// Computes the features that are rendered: the colours of the splats for the view, and their altitudes.
    fn color(
        &mut self,
        splats: &Splats<T>,
        parameters: ModelParameters<T>,
        input: &SatelliteStep<T>,
        watch: &mut Stopwatch,
    ) {
        let sun = splat_sun(input, &self.sun_visibility);
        self.appearance.splat_colors(ColorInput { parameters, splats, sun }, &mut self.colors);
        let (order, colors) = (self.sorted.order(), &self.colors);
        self.features.resize(order.len(), [T::zero(); 4]);
        let features = self.features.par_iter_mut().zip(&self.altitudes).zip(order);
        features.with_min_len(1024).for_each(|((feature, [z]), &i)| {
            let [r, g, b] = colors[i as usize];
            *feature = [r, g, b, *z];
        });
        watch.lap("splats", "colours");
    }

    /// Computes the derivatives by the renders' pixels and by the colour model's parameters, from the terms' derivatives by
    /// picture, sunlight and render.
    fn pixels_backward(
        &mut self,
        appearance: ModelParameters<T>,
        input: &SatelliteStep<T>,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) {
        let sun = input.sun.filter(|_| !self.appearance.has_shaded_splats());
        let (view, sun) = (self.view.image(), sun.map(|s| (s.image.warp, self.sun.image())));
        let shading = ShadingInput { render: view, sunlight: self.shadows.sunlight(), valid: input.valid };
        self.by_view.resize(view.width, view.height, channel::TRAINED);
        self.by_sunlight.resize(view.width, view.height, 1);
        gradient.appearance.resize(appearance.view.len(), T::zero());
        gradient.appearance.fill(T::zero());
        gradient.shared.resize(appearance.shared.len(), T::zero());
        gradient.shared.fill(T::zero());
        let by = ShadingGradient {
            by_render: &mut self.by_view,
            by_sunlight: &mut self.by_sunlight,
            by_values: &mut gradient.appearance,
        };
        let by_picture = self.terms.by_picture();
        self.appearance.shade_backward(appearance.view, shading, &by_picture, by);
        let own = Scaled { image: &self.by_sunlight, factor: T::one() };
        let by_sunlight = self.terms.by_sunlight(own);
        self.shadows.backward(view, sun, &by_sunlight, &mut self.by_view);
        self.terms.add_by_view(&mut self.by_view, |_, _| ());
        watch.lap("pixels", "picture backward");
    }

    /// Computes the derivatives by the splats' parameters from those by the renders' pixels.
    fn splats_backward(
        &mut self,
        splats: &Splats<T>,
        appearance: ModelParameters<T>,
        input: &SatelliteStep<T>,
        gradient: &mut Gradient<T>,
        watch: &mut Stopwatch,
    ) {
        let n = splats.len();
        zeros(&mut self.by_feature, n);
        zeros(&mut self.by_altitude, n);
        let normals = if self.primitive == PrimitiveKind::Disc { n } else { 0 };
        zeros(&mut self.by_normal, normals);
        let Self { terms, sorted, by_sorted, by_normal, by_feature, by_altitude, .. } = self;
        sorted.begin_gradients(terms.by_opacity(), by_sorted);
        let mut by = (&mut by_sorted[..], &mut by_normal[..]);
        backward(self.view.as_mut(), VIEW, sorted, &self.by_view, &mut by, by_feature, watch);
        for by_virtual in terms.by_virtual_view() {
            let raster = self.virtual_view.as_mut();
            backward(raster, VIRTUAL, sorted, by_virtual, &mut by, by_feature, watch);
        }
        if input.sun.is_some() && !self.appearance.has_shaded_splats() {
            let by_sun = self.shadows.by_sun();
            backward(self.sun.as_mut(), SUN, sorted, by_sun, &mut by, by_altitude, watch);
        }
        gradient.splats.resize_like(splats);
        let groups = gradient.splats.groups_mut().into_iter().zip(GROUP_INFO);
        let others = groups.filter(|(_, info)| !WRITTEN_GROUPS.contains(&info.name));
        others.for_each(|(group, _)| group.fill(T::zero()));
        sorted.parameter_gradients(splats, by_sorted, by_normal, &mut gradient.splats);
        self.by_colors.resize(n, [T::zero(); 3]);
        let rows = gradient.splats.position.par_iter_mut().zip(&mut self.by_colors).with_min_len(1024);
        rows.enumerate().for_each(|(i, (position, by_color))| {
            let rank = sorted.rank(i);
            let [r, g, b, z] = by_feature[rank];
            *by_color = [r, g, b];
            position[2] = position[2] + z + by_altitude[rank][0];
        });
        watch.lap("splats", "parameters backward");
        let sun = splat_sun(input, &self.sun_visibility);
        let colors = ColorInput { parameters: appearance, splats, sun };
        let by_light = terms.by_light();
        let Gradient { splats: by_splats, appearance: view, shared } = gradient;
        let by_parameters = ParameterGradient { shared, view };
        self.appearance.splat_colors_backward(colors, &self.by_colors, by_light, by_splats, by_parameters);
        watch.lap("splats", "colours backward");
        terms.add_by_splats(splats, &mut gradient.splats);
        watch.lap("splats", "parameters backward");
    }
}

/// Sets the vector to `n` zeros, in parallel.
fn zeros<V: Clone + Default + Send + Sync>(values: &mut Vec<V>, n: usize) {
    values.resize(n, V::default());
    values.par_chunks_mut(1 << 14).for_each(|v| v.fill(V::default()));
}

/// The sun as the splats see it; none without shadows.
fn splat_sun<'a, T: Real>(input: &SatelliteStep<T>, visibility: &'a [T]) -> Option<SplatSun<'a, T>> {
    input.sun.map(|sun| SplatSun { direction: sun.direction, visibility })
}

/// Renders an image and measures the time of the steps.
fn render<T: SimdReal, const C: usize>(
    raster: &mut dyn Renderer<T, C, QuadraticKernel<T>>,
    part: &'static str,
    sorted: &SortedSplats<T>,
    features: &[[T; C]],
    camera: &FrameCamera<QuadraticKernel<T>>,
    background: [T; C],
    watch: &mut Stopwatch,
) {
    raster.project(sorted, camera);
    watch.lap(part, "projection");
    raster.bin(features);
    watch.lap(part, "binning");
    raster.draw(background);
    watch.lap(part, "forward");
}

/// Adds the derivatives by the splats that follow from those by an image's pixels, and measures the time of the steps.
fn backward<T: SimdReal, const C: usize>(
    raster: &mut dyn Renderer<T, C, QuadraticKernel<T>>,
    part: &'static str,
    sorted: &SortedSplats<T>,
    by_pixel: &Image<T>,
    (gradients, by_normal): &mut (&mut [SplatGradient<T>], &mut [[T; 3]]),
    by_feature: &mut [[T; C]],
    watch: &mut Stopwatch,
) {
    raster.pixels_backward(by_pixel);
    watch.lap(part, "backward");
    raster.gather(sorted, gradients, by_normal, by_feature);
    watch.lap(part, "gathering");
}

#[cfg(test)]
#[path = "objective_tests.rs"]
mod tests;
