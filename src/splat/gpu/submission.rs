//! Submitting an iteration, and measuring one.

use super::arrays::REPORT;
use super::constants::GROUP;
use super::device::GpuDevice;
use super::kernel::Dispatch;
use super::views::DeviceViews;
use crate::splat::backend::GpuError;
use std::time::Duration;

/// Words of the range of a tile: `TileRange` in `wgsl/plan.wgsl`.
const RANGE_WORDS: usize = 4;

/// What a measured iteration took.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Name and time of each dispatch, in their order.
    pub kernels: Vec<(&'static str, Duration)>,
    /// Number of pairs of splats and tiles, of all renders.
    pub pairs: u32,
    /// Number of pairs of splats and pixels that the forward passes evaluate: all pixels of a tile, up to early termination.
    pub evaluated: u64,
}

/// Submits an iteration, whose report goes to `report`.
pub fn submit<V: DeviceViews>(
    gpu: &GpuDevice,
    views: &V,
    (arrays, uniform): (&V::Arrays, &V::Uniform),
    report: &wgpu::Buffer,
) -> wgpu::SubmissionIndex {
    let mut encoder = begin(gpu, views, arrays, uniform);
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        views.iteration(arrays, uniform).iter().for_each(|dispatch| dispatch.run(&mut pass));
    }
    let words = &V::common(arrays).report_words;
    encoder.copy_buffer_to_buffer(words, 0, report, 0, 4 * REPORT as u64);
    gpu.queue.submit([encoder.finish()])
}

/// Runs an iteration and measures it.
///
/// # Errors
/// [`GpuError::Lacks`] without timestamps; [`GpuError::Failed`].
pub fn measure<V: DeviceViews>(
    gpu: &GpuDevice,
    views: &V,
    (arrays, uniform): (&V::Arrays, &V::Uniform),
) -> Result<Measured, GpuError> {
    let mut encoder = begin(gpu, views, arrays, uniform);
    let list = views.iteration(arrays, uniform);
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
    let (mut pairs, mut useful) = (0, 0);
    for (raster, plan) in V::renders(arrays, uniform) {
        let [across, down] = plan.tiles();
        let ranges = gpu.read(&raster.ranges, RANGE_WORDS * (across * down) as usize)?;
        let of_tiles = ranges.as_chunks::<RANGE_WORDS>().0.iter().map(|[_, _, useful, _]| u64::from(*useful));
        useful += of_tiles.sum::<u64>();
        pairs += raster.read_pairs(gpu)?;
    }
    Ok(Measured { kernels, pairs, evaluated: useful * u64::from(GROUP) })
}

/// A list of commands that begins with what an iteration needs before its first dispatch.
fn begin<V: DeviceViews>(
    gpu: &GpuDevice,
    views: &V,
    arrays: &V::Arrays,
    uniform: &V::Uniform,
) -> wgpu::CommandEncoder {
    views.write_uniform(gpu, arrays, uniform);
    let mut encoder = gpu.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    for (raster, plan) in V::renders(arrays, uniform) {
        gpu.write(&raster.plan, &plan.words(raster.pair_capacity));
        let [across, down] = plan.tiles();
        let bytes = 4 * RANGE_WORDS as u64 * u64::from(across) * u64::from(down);
        encoder.clear_buffer(&raster.ranges, 0, Some(bytes));
    }
    encoder
}
