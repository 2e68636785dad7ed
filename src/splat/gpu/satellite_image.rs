//! The image of a satellite view on a device, and the colour model of the view.

use super::device::GpuDevice;
use crate::affine::TrainingView;
use crate::nn::adam::Adam;
use crate::splat::appearance::Appearance;
use crate::splat::backend::GpuError;
use crate::splat::loss::target::{COARSEST_LEVEL, camera_at};

/// Words of the parameters of a colour model, and of each of its moments: `MOMENTS` in `wgsl/color_model.wgsl`.
const PARAMETERS: usize = 16;

/// The image of a view.
pub struct SatelliteImage {
    /// Stored colours, a word for each pixel; zero where masked.
    pub colors: wgpu::Buffer,
    /// Linear value of each stored one.
    pub linear: wgpu::Buffer,
    /// Parameters of the colour model, and their first and second moments.
    pub appearance: wgpu::Buffer,
    /// Share of the pixels that have data, at each resolution level.
    valid_shares: [f64; COARSEST_LEVEL + 1],
}

impl SatelliteImage {
    /// Copies the image of a view to the device.
    pub fn new(gpu: &GpuDevice, view: &TrainingView) -> Result<Self, GpuError> {
        let word = |[red, green, blue]: &[u8; 3]| u32::from_le_bytes([*red, *green, *blue, 0]);
        let words: Vec<u32> = view.stored_colors().iter().map(word).collect();
        let colors = gpu.array("image", words.len() as u64)?;
        gpu.write(&colors, &words);
        let linear = gpu.array("linear values", view.linear_values().len() as u64)?;
        gpu.write_numbers(&linear, view.linear_values());
        Ok(Self {
            colors,
            linear,
            appearance: gpu.array("colour model", 3 * PARAMETERS as u64)?,
            valid_shares: std::array::from_fn(|level| valid_share(view, level)),
        })
    }

    /// Share of the pixels that have data at a resolution level.
    pub fn valid_share(&self, level: usize) -> f64 {
        self.valid_shares.get(level).copied().unwrap_or(f64::NAN)
    }

    /// Writes parameters and moments; moments are zero before the first step.
    pub fn write_appearance(&self, gpu: &GpuDevice, parts: [&[f32]; 3]) {
        let mut out = [0.0; 3 * PARAMETERS];
        for (out, part) in out.as_chunks_mut::<PARAMETERS>().0.iter_mut().zip(parts) {
            out.iter_mut().zip(part).for_each(|(out, v)| *out = *v);
        }
        gpu.write_numbers(&self.appearance, &out);
    }

    /// Reads them back after so many steps.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read_appearance(
        &self,
        gpu: &GpuDevice,
        appearance: &mut Appearance,
        adam: &mut Adam,
        steps: u32,
    ) -> Result<(), GpuError> {
        let words = gpu.read_numbers(&self.appearance, 3 * PARAMETERS)?;
        let count = appearance.values.len();
        let part = |k: usize| words[k * PARAMETERS..][..count].to_vec();
        appearance.values = part(0);
        *adam = Adam::of_parts(part(1), part(2), steps);
        Ok(())
    }
}

fn valid_share(view: &TrainingView, level: usize) -> f64 {
    let (side, (_, (width, height))) = (1 << level, camera_at(view, level));
    let pixels = (0..height).flat_map(|row| (0..width).map(move |col| (col, row)));
    let valid = pixels.filter(|(col, row)| view.block_mean(col * side, row * side, side).is_some()).count();
    valid as f64 / (width * height).max(1) as f64
}
