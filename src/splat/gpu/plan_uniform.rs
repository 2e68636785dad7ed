//! The uniform of an iteration: `Plan` in `wgsl/plan.wgsl`.

use crate::perspective::PinholeKernel;
use crate::splat::splats::PerGroup;

/// What the kernels of an iteration are told.
#[derive(Clone, Debug)]
pub struct PlanUniform {
    /// The camera.
    pub camera: PinholeKernel<f32>,
    /// Its centre, site metres.
    pub center: [f32; 3],
    /// Columns and rows of the image.
    pub size: (usize, usize),
    /// Colour behind the splats.
    pub background: [f32; 3],
    /// Number of splats.
    pub splats: usize,
    /// Number of harmonic coefficients of a channel that are used, above degree 0.
    pub coefficients: u32,
    /// Number of pairs of splats and tiles for which there is room.
    pub pair_capacity: u32,
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

/// Words of the uniform.
pub const WORDS: usize = 48;

impl PlanUniform {
    /// Columns and rows of tiles.
    pub fn tiles(&self) -> [u32; 2] {
        let (width, height) = self.size;
        [width, height].map(|v| v.div_ceil(crate::splat::raster::TILE) as u32)
    }

    /// The bytes of `Plan`, as words.
    pub fn words(&self) -> [u32; WORDS] {
        let mut out = [0; WORDS];
        let mut put = |at: usize, values: &[f32]| {
            out[at..at + values.len()].iter_mut().zip(values).for_each(|(out, v)| *out = v.to_bits());
        };
        let (camera, training) = (&self.camera, &self.training);
        for (k, (row, translation)) in camera.rotation.iter().zip(camera.translation).enumerate() {
            put(4 * k, row);
            put(4 * k + 3, &[translation]);
        }
        put(12, &camera.focal);
        put(14, &camera.principal);
        put(16, camera.limits.as_flattened());
        put(20, &self.center);
        put(23, &[camera.nearest]);
        put(24, &self.background);
        put(27, &[training.by_opacity]);
        let rates = &training.rates;
        put(28, &[rates.position, rates.opacity_logit, rates.log_scale, rates.rotation]);
        put(32, &[rates.f_dc, rates.f_rest, training.root_second, training.by_ssim, training.by_l1]);
        let [across, down] = self.tiles();
        out[37] = self.coefficients;
        out[38] = self.splats as u32;
        out[39] = training.iteration;
        out[40..42].copy_from_slice(&[self.size.0 as u32, self.size.1 as u32]);
        out[42..44].copy_from_slice(&[across, down]);
        out[44] = self.pair_capacity;
        out
    }
}
