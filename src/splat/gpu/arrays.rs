//! What the trainings of all kinds of views have in common on a device: the splats, their order, the optimiser, and the report.

use super::device::GpuDevice;
use super::frames::LossArrays;
use super::kernel::{Bound, Dispatch, Kernel};
use super::raster::SortedOrder;
use super::shader;
use super::sort::groups_for;
use super::splats::DeviceSplats;
use crate::splat::backend::GpuError;

/// Coefficients of a colour channel in `f_rest`.
const REST_OF_CHANNEL: u64 = 15;
/// Words of a report: `Report` in `wgsl/report.wgsl`, and what `wgsl/report_terms.wgsl` writes behind it.
pub const REPORT: usize = 10;

/// The compiled kernels.
pub struct CommonKernels {
    step_rest: Kernel,
    step_core: Kernel,
    report: Kernel,
}

impl CommonKernels {
    /// Compiles them.
    pub fn new(gpu: &GpuDevice) -> Self {
        let kernel = |shader| Kernel::new(gpu, shader, &[]);
        Self {
            step_rest: kernel(shader::STEP_REST),
            step_core: kernel(shader::STEP_CORE),
            report: kernel(shader::REPORT),
        }
    }
}

/// The common arrays of a training, and its kernels with them.
pub struct Common {
    /// The splats.
    pub splats: DeviceSplats,
    /// Their order, and their gradient.
    pub order: SortedOrder,
    /// Room for so many pairs of splats and tiles in each render.
    pub pair_capacity: u32,
    /// What the host reads of an iteration.
    pub report_words: wgpu::Buffer,
    step_rest: Bound,
    step_core: Bound,
    report: Bound,
}

impl Common {
    /// Of these splats; `plan` is the uniform of the view's render.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &CommonKernels,
        (plan, losses): (&wgpu::Buffer, &LossArrays),
        (order, splats): (SortedOrder, DeviceSplats),
        pair_capacity: u32,
    ) -> Result<Self, GpuError> {
        let DeviceSplats { values, first, second, .. } = &splats;
        let SortedOrder { status, gradient, opacity_sums, .. } = &order;
        let LossArrays { ssim_sums, l1_sums, .. } = losses;
        let rest = [plan, gradient, status, &values.core, &values.rest, &first.rest, &second.rest];
        let core = [plan, gradient, status, &values.core, &first.core, &second.core];
        let report_words = gpu.array("report", REPORT as u64)?;
        let report = [plan, status, opacity_sums, ssim_sums, l1_sums, &report_words];
        Ok(Self {
            step_rest: kernels.step_rest.bind(gpu, &rest),
            step_core: kernels.step_core.bind(gpu, &core),
            report: kernels.report.bind(gpu, &report),
            report_words,
            pair_capacity,
            order,
            splats,
        })
    }

    /// Adds the step of the optimiser for so many splats.
    pub fn step<'a>(&'a self, list: &mut Vec<Dispatch<'a>>, splats: usize) {
        let n = splats as u64;
        if self.splats.has_rest {
            list.push(self.step_rest.on(groups_for(REST_OF_CHANNEL * n)));
        }
        list.push(self.step_core.on(groups_for(n)));
    }

    /// Adds the report.
    pub fn report<'a>(&'a self, list: &mut Vec<Dispatch<'a>>) {
        list.push(self.report.on(groups_for(1)));
    }
}
