//! The uniform of a render in an iteration: `Plan` in `wgsl/plan.wgsl`.

use crate::camera::QuadraticKernel;
use crate::perspective::PinholeKernel;
use crate::splat::splats::PerGroup;

/// What the kernels of a render are told.
#[derive(Clone, Debug)]
pub struct PlanUniform {
    /// The camera.
    pub camera: CameraWords,
    /// Columns and rows of the image.
    pub size: (usize, usize),
    /// What is behind the splats: a colour, and in parallel projections an altitude.
    pub background: [f32; 4],
    /// Number of splats.
    pub splats: usize,
    /// Number of harmonic coefficients of a channel that are used, above degree 0.
    pub coefficients: u32,
    /// Whether another render of the iteration has begun the gradient.
    pub adds_gradient: bool,
    /// What follows belongs to the gradient.
    pub training: TrainingNumbers,
}

/// The part of [`PlanUniform`] that a render does without.
#[derive(Clone, Debug, Default)]
pub struct TrainingNumbers {
    /// Iteration, from 1.
    pub iteration: u32,
    /// Learning rates of Adam, with the correction of the first moments.
    pub rates: PerGroup<f32>,
    /// Square root of the correction of the second moments.
    pub root_second: f32,
    /// Derivative of the loss by the opacity of each splat.
    pub by_opacity: f32,
    /// Derivative of the loss by the sum of SSIM over pixels and channels.
    pub by_ssim: f32,
    /// Derivative of the loss by the sum of absolute differences.
    pub by_l1: f32,
}

/// A camera as six vectors of four numbers.
pub type CameraWords = [[f32; 4]; 6];

/// `Camera` in `wgsl/pinhole.wgsl`, of a camera with this centre (site metres).
pub fn pinhole(camera: &PinholeKernel<f32>, [x, y, z]: [f32; 3]) -> CameraWords {
    let row = |k: usize| {
        let [a, b, c] = camera.rotation[k];
        [a, b, c, camera.translation[k]]
    };
    let ([fx, fy], [px, py], [across, down]) = (camera.focal, camera.principal, camera.limits);
    let limits = [across[0], across[1], down[0], down[1]];
    [row(0), row(1), row(2), [fx, fy, px, py], limits, [x, y, z, camera.nearest]]
}

/// `Camera` in `wgsl/parallel.wgsl`.
pub fn parallel(camera: &QuadraticKernel<f32>) -> CameraWords {
    let line = |k: usize| {
        let [a, b, c] = camera.linear[k];
        [a, b, c, camera.offset[k]]
    };
    let [[a, b, c, d, e, f], [g, h, i, j, k, l]] = camera.quadratic;
    [line(0), line(1), [a, b, c, d], [e, f, 0.0, 0.0], [g, h, i, j], [k, l, 0.0, 0.0]]
}

/// Words of the uniform.
pub const WORDS: usize = 48;

impl PlanUniform {
    /// Columns and rows of tiles.
    pub fn tiles(&self) -> [u32; 2] {
        let (width, height) = self.size;
        [width, height].map(|v| v.div_ceil(crate::splat::raster::TILE) as u32)
    }

    /// The bytes of `Plan` with room for so many pairs of splats and tiles, as words.
    pub fn words(&self, pair_capacity: u32) -> [u32; WORDS] {
        let mut out = [0; WORDS];
        let mut put = |at: usize, values: &[f32]| {
            out[at..at + values.len()].iter_mut().zip(values).for_each(|(out, v)| *out = v.to_bits());
        };
        let training = &self.training;
        put(0, self.camera.as_flattened());
        put(24, &self.background);
        let rates = &training.rates;
        put(28, &[rates.position, rates.opacity_logit, rates.log_scale, rates.rotation]);
        put(32, &[rates.f_dc, rates.f_rest, training.root_second, training.by_opacity]);
        put(36, &[training.by_ssim, training.by_l1]);
        let [across, down] = self.tiles();
        out[38..40].copy_from_slice(&[self.coefficients, self.splats as u32]);
        out[40..42].copy_from_slice(&[self.size.0 as u32, self.size.1 as u32]);
        out[42..44].copy_from_slice(&[across, down]);
        out[44..46].copy_from_slice(&[pair_capacity, training.iteration]);
        out[46] = self.adds_gradient.into();
        out
    }
}
