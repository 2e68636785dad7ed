//! The splats of a training on a device, with the moments of their gradients and the statistics for densification.

use super::device::GpuDevice;
use crate::splat::anchored::Anchoring;
use crate::splat::backend::GpuError;
use crate::splat::splats::Splats;
use crate::splat::state::TrainingState;

/// Words of a splat without `f_rest`: `Core` in `wgsl/plan.wgsl`.
pub const CORE: usize = 16;
/// Word of `Core` that tells whether the splat is anchored.
const ANCHORED: usize = 15;
/// Words of a splat in `f_rest`.
pub const REST: usize = 45;

/// Parameters of splats, or moments of their gradients.
#[derive(Clone, Debug)]
pub struct SplatParameters {
    /// All but `f_rest`.
    pub core: wgpu::Buffer,
    /// `f_rest`; next to empty if splats have none.
    pub rest: wgpu::Buffer,
}

/// The splats of a training.
#[derive(Clone, Debug)]
pub struct DeviceSplats {
    /// Their parameters.
    pub values: SplatParameters,
    /// First moments.
    pub first: SplatParameters,
    /// Second moments.
    pub second: SplatParameters,
    /// Sum of gradients and number of views of each.
    pub statistics: wgpu::Buffer,
    /// Number of splats for which there is room.
    pub capacity: usize,
    /// Whether they have harmonics above degree 0.
    pub has_rest: bool,
}

impl SplatParameters {
    fn new(gpu: &GpuDevice, capacity: usize, has_rest: bool) -> Result<Self, GpuError> {
        let rest = if has_rest { capacity * REST } else { 0 };
        Ok(Self {
            core: gpu.array("splats", (capacity * CORE) as u64)?,
            rest: gpu.array("harmonics of splats", rest as u64)?,
        })
    }

    fn write(&self, gpu: &GpuDevice, splats: &Splats) {
        gpu.write_numbers(&self.core, &pack(splats));
        gpu.write_numbers(&self.rest, splats.f_rest.as_flattened());
    }

    fn read(&self, gpu: &GpuDevice, into: &mut Splats) -> Result<(), GpuError> {
        unpack(&gpu.read_numbers(&self.core, into.len() * CORE)?, into);
        let rest = gpu.read_numbers(&self.rest, into.f_rest.len() * REST)?;
        into.f_rest.as_flattened_mut().copy_from_slice(&rest);
        Ok(())
    }
}

impl DeviceSplats {
    /// Room for so many splats.
    pub fn new(gpu: &GpuDevice, capacity: usize, has_rest: bool) -> Result<Self, GpuError> {
        let parameters = || SplatParameters::new(gpu, capacity, has_rest);
        Ok(Self {
            values: parameters()?,
            first: parameters()?,
            second: parameters()?,
            statistics: gpu.array("statistics of splats", 2 * capacity as u64)?,
            capacity,
            has_rest,
        })
    }

    /// Writes the splats of a training.
    pub fn write(&self, gpu: &GpuDevice, state: &TrainingState) {
        self.values.write(gpu, &state.splats);
        let mut core = pack(&state.splats);
        for Anchoring { splat, .. } in state.anchored.anchorings() {
            core[*splat as usize * CORE + ANCHORED] = 1.0;
        }
        gpu.write_numbers(&self.values.core, &core);
        self.first.write(gpu, &state.adam.first);
        self.second.write(gpu, &state.adam.second);
        let statistics: Vec<u32> =
            state.statistics.sums().flat_map(|(sum, views)| [sum.to_bits(), views]).collect();
        gpu.write(&self.statistics, &statistics);
    }

    /// Reads them back into a state with as many.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn read(&self, gpu: &GpuDevice, state: &mut TrainingState) -> Result<(), GpuError> {
        self.values.read(gpu, &mut state.splats)?;
        self.first.read(gpu, &mut state.adam.first)?;
        self.second.read(gpu, &mut state.adam.second)?;
        let statistics = gpu.read(&self.statistics, 2 * state.splats.len())?;
        let sums = statistics.as_chunks().0.iter().map(|[sum, views]| (f32::from_bits(*sum), *views));
        state.statistics.set_sums(sums);
        Ok(())
    }
}

/// The parameters as `Core` has them.
pub fn pack(splats: &Splats) -> Vec<f32> {
    let mut out = vec![0.0; splats.len() * CORE];
    for (i, out) in out.as_chunks_mut::<CORE>().0.iter_mut().enumerate() {
        out[..3].copy_from_slice(&splats.position[i]);
        out[3] = splats.opacity_logit[i][0];
        out[4..7].copy_from_slice(&splats.log_scale[i]);
        out[8..12].copy_from_slice(&splats.rotation[i]);
        out[12..15].copy_from_slice(&splats.f_dc[i]);
    }
    out
}

/// The inverse of [`pack`].
pub fn unpack(words: &[f32], into: &mut Splats) {
    for (i, words) in words.as_chunks::<CORE>().0.iter().enumerate() {
        into.position[i].copy_from_slice(&words[..3]);
        into.opacity_logit[i] = [words[3]];
        into.log_scale[i].copy_from_slice(&words[4..7]);
        into.rotation[i].copy_from_slice(&words[8..12]);
        into.f_dc[i].copy_from_slice(&words[12..15]);
    }
}
