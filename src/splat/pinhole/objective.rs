//! The loss of one iteration on a photograph, and its gradient (3DGS).
//!
//! The view is rendered with four features: colour as displayed, and depth along the optical axis. The terms of the loss
//! ([`TermSet`]) are those of satellite scenes; the ones about the sun and virtual views are zero.

use super::super::anchored::Anchoring;
use super::super::harmonics::{SeenFrom, colors, colors_backward};
use super::super::loss::{DiscView, LossWeights, Losses, PriorTargets, Rendered, SurfaceDepth, TermSet};
use super::super::primitive::PrimitiveKind;
use super::super::raster::{
    DiscWithMoments, EllipsoidWithTransmittance, FrameCamera, Image, Primitive, Rasterizer, Scaled,
    SortedSplats, SplatGradient, channel, disc_plane,
};
use super::super::seen_gradient::SeenGradient;
use super::super::splats::Splats;
use super::super::stopwatch::Stopwatch;
use super::seen::SeenSplats;
use crate::camera::CameraKernel;
use crate::perspective::{PinholeCamera, PinholeKernel};
use crate::simd::{Real, SimdReal};
use rayon::prelude::*;

/// The part of an iteration in the table of times.
const VIEW: &str = "view";

/// What one iteration renders and compares.
pub struct PinholeStep<'a, T> {
    /// The camera.
    pub camera: &'a PinholeCamera,
    /// Depth up to which nothing is drawn: [`NEAREST`](super::NEAREST) in the working frame.
    pub nearest: f64,
    /// The photograph: colours as displayed, 0 to 1, zero where masked.
    pub target: &'a Image<T>,
    /// Which pixels are valid, row by row; empty if all are.
    pub valid: &'a [bool],
    /// Depths and normals that are expected of the view; none without priors.
    pub priors: Option<&'a PriorTargets>,
    /// The splats that are anchored to others. If there are any, all splats take part, as anchors move what is anchored to them.
    pub anchored: &'a [Anchoring],
    /// Colour behind the splats.
    pub background: [T; 3],
    /// Degree of the spherical harmonics that are used.
    pub sh_degree: usize,
    /// Which depth of discs is the surface's.
    pub surface: SurfaceDepth,
}

impl<T: SimdReal> PinholeStep<'_, T> {
    fn seen_from(&self) -> SeenFrom<T> {
        SeenFrom { center: self.camera.center.to_array().map(T::from_f64), degree: self.sh_degree }
    }

    fn frame(&self) -> FrameCamera<PinholeKernel<T>> {
        let (width, height) = self.camera.size;
        FrameCamera { kernel: self.camera.kernel(self.nearest), width, height }
    }
}

/// The objective of ellipsoids: features are red, green, blue and depth.
pub type EllipsoidObjective<T> = PinholeObjective<T, { channel::TRANSMITTANCE }, EllipsoidWithTransmittance>;
/// The objective of discs: features are red, green, blue, depth and the normal that faces the camera, in site axes.
pub type DiscObjective<T> = PinholeObjective<T, { disc_plane::FEATURES }, DiscWithMoments>;

/// The objective of splats of a kind that is chosen while the program runs.
pub trait AnyPinholeObjective<T>: Send + Sync {
    /// [`PinholeObjective::evaluate`].
    fn evaluate(
        &mut self,
        splats: &Splats<T>,
        input: &PinholeStep<T>,
        weights: &LossWeights,
        gradient: &mut SeenGradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses;
    /// [`PinholeObjective::forward`].
    fn forward(&mut self, splats: &Splats<T>, input: &PinholeStep<T>, watch: &mut Stopwatch);
    /// [`PinholeObjective::view`].
    fn view(&self) -> &Image<T>;
    /// [`PinholeObjective::mean2d_gradient`].
    fn mean2d_gradient(&self, place: usize) -> Option<[T; 2]>;
}

/// The objective of a kind of splats, with these loss terms.
#[must_use]
pub fn objective<T: SimdReal>(
    primitive: PrimitiveKind,
    terms: TermSet<T>,
) -> Box<dyn AnyPinholeObjective<T>> {
    match primitive {
        PrimitiveKind::Ellipsoid => Box::new(EllipsoidObjective::new(terms)),
        PrimitiveKind::Disc => Box::new(DiscObjective::new(terms)),
    }
}

impl<T: SimdReal, const F: usize, P: Primitive> AnyPinholeObjective<T> for PinholeObjective<T, F, P> {
    fn evaluate(
        &mut self,
        splats: &Splats<T>,
        input: &PinholeStep<T>,
        weights: &LossWeights,
        gradient: &mut SeenGradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses {
        Self::evaluate(self, splats, input, weights, gradient, watch)
    }

    fn forward(&mut self, splats: &Splats<T>, input: &PinholeStep<T>, watch: &mut Stopwatch) {
        Self::forward(self, splats, input, watch);
    }

    fn view(&self) -> &Image<T> {
        Self::view(self)
    }

    fn mean2d_gradient(&self, place: usize) -> Option<[T; 2]> {
        Self::mean2d_gradient(self, place)
    }
}

/// Computes losses and gradients of splats with `F` features; keeps all buffers between iterations.
pub struct PinholeObjective<T: Real, const F: usize, P: Primitive> {
    seen: SeenSplats<T>,
    sorted: SortedSplats<T>,
    view: Rasterizer<T, F, PinholeKernel<T>, P>,
    colors: Vec<[T; 3]>,
    features: Vec<[T; F]>,
    by_colors: Vec<[T; 3]>,
    by_feature: Vec<[T; F]>,
    by_sorted: Vec<SplatGradient<T>>,
    /// Derivatives by the normals of discs; empty for ellipsoids.
    by_normal: Vec<[T; 3]>,
    picture: Image<T>,
    by_view: Image<T>,
    terms: TermSet<T>,
}

impl<T: SimdReal, const F: usize, P: Primitive> PinholeObjective<T, F, P> {
    /// The objective with these loss terms.
    #[must_use]
    pub fn new(terms: TermSet<T>) -> Self {
        Self {
            seen: SeenSplats::default(),
            sorted: SortedSplats::of(if P::IS_FLAT { PrimitiveKind::Disc } else { PrimitiveKind::Ellipsoid }),
            view: Rasterizer::default(),
            colors: Vec::new(),
            features: Vec::new(),
            by_colors: Vec::new(),
            by_feature: Vec::new(),
            by_sorted: Vec::new(),
            by_normal: Vec::new(),
            picture: Image::default(),
            by_view: Image::default(),
            terms,
        }
    }

    /// Computes the loss of one iteration; writes the derivatives by the splats' parameters to `gradient` and adds the time of
    /// each part to `watch`.
    pub fn evaluate(
        &mut self,
        splats: &Splats<T>,
        input: &PinholeStep<T>,
        weights: &LossWeights,
        gradient: &mut SeenGradient<T>,
        watch: &mut Stopwatch,
    ) -> Losses {
        self.forward(splats, input, watch);
        let rendered = Rendered {
            light: None,
            visibility: None,
            crop: None,
            priors: input.priors,
            anchored: input.anchored,
            view: self.view.image(),
            discs: P::IS_FLAT.then_some(DiscView { camera: input.camera, surface: input.surface }),
            picture: &self.picture,
            sunlight: None,
            virtual_view: None,
            target: input.target,
            splats,
            mean_opacity: self.seen.mean_opacity,
        };
        let losses = self.terms.evaluate(&rendered, weights, input.valid, watch);
        self.pixels_backward(input.valid);
        watch.lap("pixels", "picture backward");
        self.splats_backward(input, gradient, watch);
        losses
    }

    /// Renders the view without loss and gradient; the target of `input` is ignored.
    pub fn forward(&mut self, splats: &Splats<T>, input: &PinholeStep<T>, watch: &mut Stopwatch) {
        let mut camera = input.frame();
        if P::IS_FLAT {
            camera.kernel = camera.kernel.without_limits();
        }
        let kind = if P::IS_FLAT { PrimitiveKind::Disc } else { PrimitiveKind::Ellipsoid };
        self.seen.select(splats, kind, input.anchored.is_empty().then_some(&camera));
        watch.lap("splats", "selection");
        let splats = &self.seen.splats;
        self.sorted.update_for(splats, &camera.kernel);
        watch.lap("splats", "order and covariances");
        colors(splats, &input.seen_from(), &mut self.colors);
        let (order, colors) = (self.sorted.order(), &self.colors);
        self.features.resize(order.len(), [T::zero(); F]);
        let (sorted, from) = (&self.sorted, input.seen_from().center);
        let features = self.features.par_iter_mut().zip(order).with_min_len(1024);
        features.enumerate().for_each(|(rank, (feature, &i))| {
            let (color, position) = (colors[i as usize], splats.position[i as usize]);
            feature[..channel::DEPTH].copy_from_slice(&color);
            feature[channel::DEPTH] = T::zero() - camera.kernel.depth_key(position);
            if P::IS_FLAT {
                let normal = sorted.normal(rank);
                let side = side_of(normal, position, from);
                feature[channel::NORMAL..].copy_from_slice(&normal.map(|v| side * v));
            }
        });
        watch.lap("splats", "colours");
        self.view.project(&self.sorted, &camera);
        watch.lap(VIEW, "projection");
        self.view.bin(&self.features);
        watch.lap(VIEW, "binning");
        let mut background = [T::zero(); F];
        background[..3].copy_from_slice(&input.background);
        self.view.draw(background);
        watch.lap(VIEW, "forward");
        self.draw_picture(input.valid);
        watch.lap("pixels", "picture");
    }

    /// The render of the last forward pass: colour, depth times opacity, transmittance.
    #[must_use]
    pub fn view(&self) -> &Image<T> {
        self.view.image()
    }

    /// Derivative of the loss with respect to the 2-D mean (column, row) of the splat at a place of [`SeenGradient::indices`],
    /// per pixel, as the last evaluation computed it; none if the splat was not visible.
    #[must_use]
    pub fn mean2d_gradient(&self, place: usize) -> Option<[T; 2]> {
        self.view.mean2d_gradient(self.sorted.rank(place))
    }

    /// Copies the colours of the render; zero where masked.
    fn draw_picture(&mut self, valid: &[bool]) {
        let view = self.view.image();
        let width = view.width;
        self.picture.resize(width, view.height, 3);
        let rows = self.picture.data.par_chunks_mut(3 * width).with_min_len(16);
        rows.enumerate().for_each(|(row, out)| {
            for (c, out) in out.chunks_exact_mut(width).enumerate() {
                out.copy_from_slice(view.row(c, row));
                mask(out, valid, row);
            }
        });
    }

    /// Computes the derivatives by the render's pixels from those of the terms by picture and render.
    fn pixels_backward(&mut self, valid: &[bool]) {
        let (width, height) = (self.picture.width, self.picture.height);
        let by_view = &mut self.by_view;
        let planes = P::trained_planes(F);
        by_view.resize(width, height, planes);
        let by_picture = self.terms.by_picture();
        self.terms.add_by_view(by_view, |row, out| {
            out.fill(T::zero());
            for (c, out) in out.chunks_exact_mut(width).take(3).enumerate() {
                for part in by_picture.iter().flatten() {
                    add_row(out, part, c, row);
                }
                mask(out, valid, row);
            }
        });
    }

    /// Computes the derivatives by the splats' parameters from those by the render's pixels.
    fn splats_backward(
        &mut self,
        input: &PinholeStep<T>,
        gradient: &mut SeenGradient<T>,
        watch: &mut Stopwatch,
    ) {
        let SeenGradient { indices, of_seen, by_opacity } = gradient;
        indices.clone_from(&self.seen.indices);
        *by_opacity = self.terms.by_opacity();
        let n = indices.len();
        self.by_feature.resize(n, [T::zero(); F]);
        self.by_feature.par_chunks_mut(1 << 14).for_each(|v| v.fill([T::zero(); F]));
        let Self { terms, sorted, by_sorted, by_normal, by_feature, seen, .. } = self;
        let splats = &seen.splats;
        sorted.begin_gradients(*by_opacity, by_sorted);
        self.view.pixels_backward(&self.by_view);
        watch.lap(VIEW, "backward");
        self.view.gather(sorted, by_sorted, by_feature);
        watch.lap(VIEW, "gathering");
        if P::IS_FLAT {
            let from = input.seen_from().center;
            by_normal.resize(n, [T::zero(); 3]);
            let normals = by_normal.par_iter_mut().zip(&*by_feature).zip(sorted.order()).with_min_len(1024);
            normals.enumerate().for_each(|(rank, ((by_normal, by_feature), &i))| {
                let side = side_of(sorted.normal(rank), splats.position[i as usize], from);
                *by_normal = [0, 1, 2].map(|k| side * by_feature[channel::NORMAL + k]);
            });
            self.view.add_normal_gradients(by_normal);
        }
        of_seen.resize_like(splats);
        sorted.parameter_gradients(splats, by_sorted, by_normal, of_seen);
        watch.lap("splats", "parameters backward");
        let forward = input.camera.cam_from_site.row(2).to_array().map(T::from_f64);
        self.by_colors.resize(n, [T::zero(); 3]);
        let rows = of_seen.position.par_iter_mut().zip(&mut self.by_colors).with_min_len(1024);
        rows.enumerate().for_each(|(i, (position, by_color))| {
            let by = &by_feature[sorted.rank(i)];
            *by_color = [by[0], by[1], by[2]];
            let depth = by[channel::DEPTH];
            for k in 0..3 {
                position[k] = position[k] + forward[k] * depth;
            }
        });
        colors_backward(splats, &input.seen_from(), &self.colors, &self.by_colors, of_seen);
        watch.lap("splats", "colours backward");
        terms.add_by_splats(splats, of_seen);
    }
}

/// 1 if a normal points to the side of its plane on which the camera is, else -1.
fn side_of<T: Real>(normal: [T; 3], position: [T; 3], camera: [T; 3]) -> T {
    let sight: [T; 3] = std::array::from_fn(|k| camera[k] - position[k]);
    let along = normal[0] * sight[0] + normal[1] * sight[1] + normal[2] * sight[2];
    if along < T::zero() { -T::one() } else { T::one() }
}

/// Sets pixels of a row without data to zero.
fn mask<T: Real>(out: &mut [T], valid: &[bool], row: usize) {
    let width = out.len();
    // Without masked pixels the list is empty.
    if let Some(valid) = valid.get(row * width..(row + 1) * width) {
        for (out, is_valid) in out.iter_mut().zip(valid) {
            *out = if *is_valid { *out } else { T::zero() };
        }
    }
}

/// Adds a row of scaled derivatives.
fn add_row<T: Real>(sum: &mut [T], part: &Scaled<T>, channel: usize, row: usize) {
    for (sum, by) in sum.iter_mut().zip(part.image.row(channel, row)) {
        *sum = *sum + part.factor * *by;
    }
}

#[cfg(test)]
#[path = "objective_tests.rs"]
mod tests;
