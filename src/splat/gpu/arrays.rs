//! All arrays of a training on a device, and an iteration as a list of dispatches.

use super::constants::GROUP;
use super::device::GpuDevice;
use super::frames::Frames;
use super::kernel::{Bound, Dispatch, Kernel};
use super::photographs::DevicePhotograph;
use super::photometric::{Photometric, PhotometricKernels, REPORT};
use super::plan_uniform::PlanUniform;
use super::raster::{Raster, RasterKernels};
use super::shader;
use super::sort::groups_for;
use super::splats::DeviceSplats;
use crate::splat::backend::GpuError;
use std::time::Duration;

/// Coefficients of a colour channel in `f_rest`.
const REST_OF_CHANNEL: u64 = 15;
/// Words of the range of a tile: `TileRange` in `wgsl/plan.wgsl`.
const RANGE_WORDS: usize = 4;

/// What a measured iteration took.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Name and time of each dispatch, in their order.
    pub kernels: Vec<(&'static str, Duration)>,
    /// Number of pairs of splats and tiles.
    pub pairs: u32,
    /// Number of pairs of splats and pixels that the forward pass evaluates: all pixels of a tile, up to early termination.
    pub evaluated: u64,
}

/// All compiled kernels.
pub struct Kernels {
    raster: RasterKernels,
    photometric: PhotometricKernels,
    step_rest: Kernel,
    step_core: Kernel,
}

impl Kernels {
    /// Compiles them.
    pub fn new(gpu: &GpuDevice) -> Self {
        Self {
            raster: RasterKernels::new(gpu),
            photometric: PhotometricKernels::new(gpu),
            step_rest: Kernel::new(gpu, shader::STEP_REST, &[]),
            step_core: Kernel::new(gpu, shader::STEP_CORE, &[]),
        }
    }
}

/// The arrays of a training, and its kernels with them.
pub struct Arrays {
    /// The splats.
    pub splats: DeviceSplats,
    /// The rasteriser.
    pub raster: Raster,
    losses: Vec<Photometric>,
    step_rest: Bound,
    step_core: Bound,
    report: Bound,
    report_words: wgpu::Buffer,
}

impl Arrays {
    /// Arrays for these splats, with room for so many pairs of splats and tiles.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &Kernels,
        (frames, photographs): (&Frames, &[DevicePhotograph]),
        splats: DeviceSplats,
        pair_capacity: u32,
    ) -> Result<Self, GpuError> {
        let DeviceSplats { values, first, second, statistics, capacity, .. } = &splats;
        let room = (*capacity, pair_capacity);
        let raster = Raster::new(gpu, &kernels.raster, frames, (values, statistics), room)?;
        let (plan, status, gradient) = (&raster.plan, &raster.status, &raster.gradient);
        let of_photograph =
            |p: &DevicePhotograph| Photometric::new(gpu, &kernels.photometric, plan, frames, &p.pixels);
        let rest = [plan, gradient, status, &values.core, &values.rest, &first.rest, &second.rest];
        let core = [plan, gradient, status, &values.core, &first.core, &second.core];
        let report_words = gpu.array("report", REPORT as u64)?;
        Ok(Self {
            losses: photographs.iter().map(of_photograph).collect(),
            step_rest: kernels.step_rest.bind(gpu, &rest),
            step_core: kernels.step_core.bind(gpu, &core),
            report: kernels.photometric.bind_report(gpu, &raster, frames, &report_words),
            report_words,
            raster,
            splats,
        })
    }

    /// The dispatches of an iteration on a view.
    fn iteration(&self, plan: &PlanUniform, view: usize) -> Vec<Dispatch<'_>> {
        let (mut list, n) = (Vec::new(), plan.splats as u64);
        self.raster.forward(&mut list, plan);
        list.extend(self.losses[view].on(plan));
        self.raster.backward(&mut list, plan);
        if self.splats.has_rest {
            list.push(self.step_rest.on(groups_for(REST_OF_CHANNEL * n)));
        }
        list.push(self.step_core.on(groups_for(n)));
        list.push(self.report.on(groups_for(1)));
        list
    }

    /// Submits an iteration on a view, whose report goes to `report`.
    pub fn submit(
        &self,
        gpu: &GpuDevice,
        frames: &Frames,
        (plan, view): (&PlanUniform, usize),
        report: &wgpu::Buffer,
    ) -> wgpu::SubmissionIndex {
        let mut encoder = self.begin(gpu, frames, plan);
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            self.iteration(plan, view).iter().for_each(|dispatch| dispatch.run(&mut pass));
        }
        encoder.copy_buffer_to_buffer(&self.report_words, 0, report, 0, 4 * REPORT as u64);
        gpu.queue.submit([encoder.finish()])
    }

    /// Runs an iteration on a view and measures it.
    ///
    /// # Errors
    /// [`GpuError::Lacks`] without timestamps; [`GpuError::Failed`].
    pub fn measure(
        &self,
        gpu: &GpuDevice,
        frames: &Frames,
        (plan, view): (&PlanUniform, usize),
    ) -> Result<Measured, GpuError> {
        let mut encoder = self.begin(gpu, frames, plan);
        let list = self.iteration(plan, view);
        let stamps = gpu.timestamps(2 * list.len() as u32)?;
        for (dispatch, first) in list.iter().zip((0..).step_by(2)) {
            let timestamp_writes = Some(wgpu::ComputePassTimestampWrites {
                query_set: &stamps,
                beginning_of_pass_write_index: Some(first),
                end_of_pass_write_index: Some(first + 1),
            });
            let descriptor = wgpu::ComputePassDescriptor { label: None, timestamp_writes };
            dispatch.run(&mut encoder.begin_compute_pass(&descriptor));
        }
        gpu.queue.submit([encoder.finish()]);
        let times = gpu.read_timestamps(&stamps, 2 * list.len() as u32)?;
        let times = times.as_chunks().0.iter().map(|[begin, end]| end.saturating_sub(*begin));
        let kernels = list.iter().map(Dispatch::name).zip(times).collect();
        let [across, down] = plan.tiles();
        let ranges = gpu.read(&frames.ranges, RANGE_WORDS * (across * down) as usize)?;
        let useful = ranges.as_chunks::<RANGE_WORDS>().0.iter().map(|[_, _, useful, _]| u64::from(*useful));
        let evaluated = useful.sum::<u64>() * u64::from(GROUP);
        Ok(Measured { kernels, pairs: self.raster.read_pairs(gpu)?, evaluated })
    }

    /// A list of commands that begins with what an iteration needs before its first dispatch.
    fn begin(&self, gpu: &GpuDevice, frames: &Frames, plan: &PlanUniform) -> wgpu::CommandEncoder {
        gpu.write(&self.raster.plan, &plan.words());
        let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let [across, down] = plan.tiles();
        encoder.clear_buffer(
            &frames.ranges,
            0,
            Some(4 * RANGE_WORDS as u64 * u64::from(across) * u64::from(down)),
        );
        encoder
    }
}
