//! SatGS's colour model (Bai et al. 2025, §3.3): appearance by season and light, with shadows.
//!
//! The colour of a splat is toned for the view by a network, from an encoding of its position and the embedding of the view,
//! and darkened where another network finds it in the shadow for the direction to the sun. The ambient light follows from
//! that direction. Colours are those that images show, not linear ones. All networks start such that toned colours are the
//! colours of the splats. Unlike the paper's, the shadow network also takes the visibility of the sun, which follows from the
//! heights, and the tone network only the coarser features. The encoding of a position is also the splat's own embedding, and no derivative goes to
//! positions, nor to colours as inputs of the network.

mod block;
mod file;
mod networks;

pub use file::{AppearanceContent, AppearanceError, TrainedAppearance, TrainedView};
pub use networks::{NetworkGroup, Networks};

use super::light::SplatLight;
use super::model::{AppearanceModel, ColorInput, ParameterGradient, ShadingGradient, ShadingInput, SplatSun};
use crate::nn::linear::BLOCK;
use crate::nn::mlp::MlpBlock;
use crate::simd::{Real, Simd, SimdKernel, SimdReal};
use crate::splat::raster::{Image, Scaled};
use crate::splat::splats::{Splats, color_from_f_dc, f_dc_gradient};
use block::{Backward, BlockBuffers, BlockInput, Forward, GradientSums, ViewNetworks, logistic};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Number of parts of the splats whose gradients are summed apart; fixed, so that sums do not depend on the threads.
const PARTS: usize = 16;

/// The cube that the encoding of positions covers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cube {
    /// Its western, southern, lowest corner, site metres.
    pub corner: [f64; 3],
    /// Length of its sides, metres.
    pub side_m: f64,
}

impl Cube {
    /// The smallest cube with the area (west, south, east, north) and the altitudes (lowest, highest) at its corner.
    #[must_use]
    pub fn around(area: (f64, f64, f64, f64), altitudes: (f64, f64)) -> Self {
        let (west, south, east, north) = area;
        let sides = [east - west, north - south, altitudes.1 - altitudes.0];
        Self {
            corner: [west, south, altitudes.0],
            side_m: sides.into_iter().fold(f64::MIN_POSITIVE, f64::max),
        }
    }
}

/// The model; keeps its buffers between calls.
pub struct SatGs<T> {
    networks: Networks,
    cube: Cube,
    /// Positions in the unit cube.
    positions: Vec<[T; 3]>,
    /// Position features, block by block.
    features: Vec<T>,
    by_features: Vec<T>,
    /// Colours of the splats.
    colors: Vec<[T; 3]>,
    by_splat_colors: Vec<[T; 3]>,
    light: SplatLight<T>,
    has_sun: bool,
    parts: Vec<Part<T>>,
}

/// Buffers and sums of a part of the splats.
#[derive(Default)]
struct Part<T> {
    buffers: BlockBuffers<T>,
    sums: GradientSums<T>,
}

impl<T: SimdReal> SatGs<T> {
    /// The model for a scene within a cube.
    #[must_use]
    pub fn new(networks: Networks, cube: Cube) -> Self {
        let mut parts = Vec::new();
        parts.resize_with(PARTS, Part::default);
        Self {
            networks,
            cube,
            positions: Vec::new(),
            features: Vec::new(),
            by_features: Vec::new(),
            colors: Vec::new(),
            by_splat_colors: Vec::new(),
            light: SplatLight::default(),
            has_sun: false,
            parts,
        }
    }

    /// The networks for a view.
    fn view_networks(&self, input: &ColorInput<T>) -> ViewNetworks<T> {
        let [_, tone, shadow, _] = self.networks.ranges().map(|range| &input.parameters.shared[range]);
        ViewNetworks {
            tone: self.networks.tone.with(tone, input.parameters.view),
            shadow: input.sun.map(|sun| self.networks.shadow.with(shadow, &sun.direction)),
            ambient: input
                .sun
                .map_or([T::one(); 3], |sun| self.sky(input.parameters.shared, sun.direction, None)),
        }
    }

    /// The ambient light for a direction to the sun. Adds the derivatives by the sky network's parameters to the second of
    /// `by`, from those by the ambient light, the first.
    fn sky(&self, shared: &[T], sun: [T; 3], by: Option<([T; 3], &mut [T])>) -> [T; 3] {
        let [.., range] = self.networks.ranges();
        let mut ambient = [T::zero(); 3];
        T::dispatch(Sky { networks: &self.networks, values: &shared[range], sun, by, ambient: &mut ambient });
        ambient
    }
}

impl<T: SimdReal> AppearanceModel<T> for SatGs<T> {
    fn start_shared(&self, seed: u64) -> Vec<T> {
        self.networks.start(seed)
    }

    fn start_view(&self, seed: u64, view: u64) -> Vec<T> {
        self.networks.start_embedding(seed, view)
    }

    fn has_shaded_splats(&self) -> bool {
        true
    }

    fn splat_colors(&mut self, input: ColorInput<T>, colors: &mut Vec<[T; 3]>) {
        let Cube { corner, side_m } = self.cube;
        let unit =
            |p: &[T; 3]| std::array::from_fn(|k| (p[k] - T::from_f64(corner[k])) * T::from_f64(1.0 / side_m));
        let n = input.splats.len();
        input.splats.position.par_iter().with_min_len(1024).map(unit).collect_into_vec(&mut self.positions);
        let f_dc = input.splats.f_dc.par_iter().with_min_len(1024);
        f_dc.map(|f| color_from_f_dc(*f)).collect_into_vec(&mut self.colors);
        let [tables, ..] = self.networks.ranges();
        self.networks.grid.encode(&input.parameters.shared[tables], &self.positions, &mut self.features);
        let networks = self.view_networks(&input);
        self.has_sun = input.sun.is_some();
        self.light.ambient = networks.ambient;
        self.light.toned.resize(n, [T::zero(); 3]);
        self.light.sunlit.resize(n, T::zero());
        colors.resize(n, [T::zero(); 3]);
        let (block_size, size) = (self.networks.grid.outputs() * BLOCK, part_size(n));
        let features = self.features.par_chunks(size / BLOCK * block_size);
        let light = self.light.toned.par_chunks_mut(size).zip(self.light.sunlit.par_chunks_mut(size));
        let parts = features.zip(self.colors.par_chunks(size)).zip(light).zip(colors.par_chunks_mut(size));
        let parts = parts.zip(&mut self.parts).enumerate();
        parts.for_each(|(k, ((((features, own), (toned, sunlit)), colors), part))| {
            let blocks = features.chunks(block_size).zip(own.chunks(BLOCK));
            let blocks = blocks.zip(toned.chunks_mut(BLOCK).zip(sunlit.chunks_mut(BLOCK))).enumerate();
            for (b, ((features, colors), (toned, sunlit))) in blocks {
                let first = k * size + b * BLOCK;
                let visible = visibility(input.sun, first..first + colors.len());
                let input = BlockInput { networks: &networks, features, colors, visible };
                T::dispatch(Forward { input, buffers: &mut part.buffers, toned, sunlit });
            }
            for ((color, toned), s) in colors.iter_mut().zip(toned).zip(sunlit) {
                let light = networks.ambient.map(|a| *s + (T::one() - *s) * a);
                *color = std::array::from_fn(|c| toned[c] * light[c]);
            }
        });
    }

    fn light(&self) -> Option<&SplatLight<T>> {
        self.has_sun.then_some(&self.light)
    }

    fn splat_colors_backward(
        &mut self,
        input: ColorInput<T>,
        by_colors: &[[T; 3]],
        by_light: Option<&SplatLight<T>>,
        by_splats: &mut Splats<T>,
        by_parameters: ParameterGradient<T>,
    ) {
        let networks = self.view_networks(&input);
        let n = input.splats.len();
        let (block_size, size) = (self.networks.grid.outputs() * BLOCK, part_size(n));
        self.by_features.resize(self.features.len(), T::zero());
        self.by_splat_colors.resize(n, [T::zero(); 3]);
        let shadow_size = networks.shadow.as_ref().map_or(0, |s| s.parameters());
        for Part { sums, .. } in &mut self.parts {
            sums.ambient = [T::zero(); 3];
            restart(&mut sums.tone, networks.tone.parameters());
            restart(&mut sums.shadow, shadow_size);
        }
        let light = &self.light;
        let inputs = self.features.par_chunks(size / BLOCK * block_size).zip(self.colors.par_chunks(size));
        let outputs = self.by_features.par_chunks_mut(size / BLOCK * block_size);
        let outputs = outputs.zip(self.by_splat_colors.par_chunks_mut(size)).zip(&mut self.parts);
        inputs.zip(outputs).enumerate().for_each(
            |(k, ((features, colors), ((by_features, by_own), part)))| {
                let inputs = features.chunks(block_size).zip(colors.chunks(BLOCK));
                let outputs = by_features.chunks_mut(block_size).zip(by_own.chunks_mut(BLOCK));
                for (b, ((features, colors), (by_features, by_splat_colors))) in
                    inputs.zip(outputs).enumerate()
                {
                    let first = k * size + b * BLOCK;
                    let items = first..first + colors.len();
                    T::dispatch(Backward {
                        input: BlockInput {
                            networks: &networks,
                            features,
                            colors,
                            visible: visibility(input.sun, items.clone()),
                        },
                        buffers: &mut part.buffers,
                        toned: &light.toned[items.clone()],
                        sunlit: &light.sunlit[items.clone()],
                        by_colors: &by_colors[items],
                        by_light,
                        first,
                        by_features,
                        by_splat_colors,
                        sums: &mut part.sums,
                    });
                }
            },
        );
        let [tables, tone, shadow, sky] = self.networks.ranges();
        let (shared, by_shared) = (input.parameters.shared, by_parameters.shared);
        self.networks.grid.encode_backward(&self.positions, &self.by_features, &mut by_shared[tables]);
        let sums = total(&self.parts);
        let (values, by) = (&shared[tone.clone()], &mut by_shared[tone]);
        self.networks.tone.add_gradient(&sums.tone, values, input.parameters.view, by, by_parameters.view);
        if let Some(SplatSun { direction: sun, .. }) = input.sun {
            let (values, by) = (&shared[shadow.clone()], &mut by_shared[shadow]);
            self.networks.shadow.add_gradient(&sums.shadow, values, &sun, by, &mut [T::zero(); 3]);
            let own = by_light.map_or([T::zero(); 3], |l| l.ambient);
            let by_ambient = std::array::from_fn(|c| sums.ambient[c] + own[c]);
            self.sky(shared, sun, Some((by_ambient, &mut by_shared[sky])));
        }
        let rows = by_splats.f_dc.par_iter_mut().zip(&self.by_splat_colors).with_min_len(1024);
        rows.for_each(|(f_dc, by)| *f_dc = f_dc_gradient(*by));
    }

    fn shade(&mut self, _: &[T], input: ShadingInput<T>, picture: &mut Image<T>) {
        let Image { width, height, .. } = *input.render;
        picture.resize(width, height, 3);
        picture.data.par_chunks_mut(3 * width).enumerate().for_each(|(row, line)| {
            for (c, line) in line.chunks_mut(width).enumerate() {
                line.copy_from_slice(input.render.row(c, row));
                mask(line, input.valid, row);
            }
        });
    }

    fn shade_backward(
        &mut self,
        _: &[T],
        input: ShadingInput<T>,
        by_picture: &[Option<Scaled<T>>],
        gradient: ShadingGradient<T>,
    ) {
        let Image { width, channels, .. } = *input.render;
        let lines = gradient.by_render.data.par_chunks_mut((channels - 1) * width);
        lines.enumerate().for_each(|(row, lines)| {
            for (c, line) in lines.chunks_mut(width).take(3).enumerate() {
                line.fill(T::zero());
                for part in by_picture.iter().flatten() {
                    let by = part.image.row(c, row);
                    line.iter_mut().zip(by).for_each(|(sum, by)| *sum = *sum + part.factor * *by);
                }
                mask(line, input.valid, row);
            }
        });
    }
}

/// Visibility of the sun from some splats; empty without a sun.
fn visibility<T>(sun: Option<SplatSun<'_, T>>, items: Range<usize>) -> &[T] {
    sun.map_or(&[], |sun| &sun.visibility[items])
}

/// Number of splats of a part: whole blocks.
fn part_size(splats: usize) -> usize {
    splats.div_ceil(PARTS).div_ceil(BLOCK).max(1) * BLOCK
}

/// Zeros of this number.
fn restart<T: Real>(values: &mut Vec<T>, len: usize) {
    values.clear();
    values.resize(len, T::zero());
}

/// Sets the pixels of a row that are not valid to zero.
fn mask<T: Real>(line: &mut [T], valid: &[bool], row: usize) {
    let valid = valid.get(row * line.len()..(row + 1) * line.len()).unwrap_or_default();
    line.iter_mut().zip(valid).filter(|(_, is_valid)| !**is_valid).for_each(|(v, _)| *v = T::zero());
}

/// The sums over all parts, in their order.
fn total<T: Real>(parts: &[Part<T>]) -> GradientSums<T> {
    let mut total = parts[0].sums.clone();
    for Part { sums, .. } in &parts[1..] {
        let add = |to: &mut [T], by: &[T]| to.iter_mut().zip(by).for_each(|(sum, by)| *sum = *sum + *by);
        add(&mut total.tone, &sums.tone);
        add(&mut total.shadow, &sums.shadow);
        add(&mut total.ambient, &sums.ambient);
    }
    total
}

/// The sky network for one direction: the first item of a block.
struct Sky<'a, T> {
    networks: &'a Networks,
    values: &'a [T],
    sun: [T; 3],
    by: Option<([T; 3], &'a mut [T])>,
    ambient: &'a mut [T; 3],
}

impl<T: Real> SimdKernel<T> for Sky<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        let network = self.networks.sky.with(self.values, &[]);
        let mut inputs = vec![T::zero(); 3 * BLOCK];
        (0..3).for_each(|k| inputs[k * BLOCK] = self.sun[k]);
        let mut block = MlpBlock::default();
        let logits = block.forward(simd, &network, &inputs);
        *self.ambient = std::array::from_fn(|c| logistic(logits[c * BLOCK]));
        if let Some((by_ambient, by_values)) = self.by {
            let mut by_logits = vec![T::zero(); 3 * BLOCK];
            for c in 0..3 {
                let a = self.ambient[c];
                by_logits[c * BLOCK] = by_ambient[c] * a * (T::one() - a);
            }
            let mut by_own = vec![T::zero(); network.parameters()];
            block.backward(simd, &network, &inputs, &by_logits, &mut by_own);
            self.networks.sky.add_gradient(&by_own, self.values, &[], by_values, &mut []);
        }
    }
}
