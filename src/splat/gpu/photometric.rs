//! The photometric loss on a device, and the report of an iteration.

use super::device::GpuDevice;
use super::frames::Frames;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::plan_uniform::PlanUniform;
use super::raster::Raster;
use super::shader;

/// Words of `Report` in `wgsl/report.wgsl`.
pub const REPORT: usize = 5;

/// The compiled kernels.
pub struct PhotometricKernels {
    forward: Kernel,
    backward: Kernel,
    report: Kernel,
}

impl PhotometricKernels {
    /// Compiles them.
    pub fn new(gpu: &GpuDevice) -> Self {
        let kernel = |shader| Kernel::new(gpu, shader, &[]);
        Self {
            forward: kernel(shader::SSIM_FORWARD),
            backward: kernel(shader::SSIM_BACKWARD),
            report: kernel(shader::REPORT),
        }
    }

    /// The report with its arrays.
    pub fn bind_report(
        &self,
        gpu: &GpuDevice,
        raster: &Raster,
        frames: &Frames,
        report: &wgpu::Buffer,
    ) -> Bound {
        let Frames { ssim_sums, l1_sums, .. } = frames;
        self.report
            .bind(gpu, &[&raster.plan, &raster.status, &raster.opacity_sums, ssim_sums, l1_sums, report])
    }
}

/// The loss of one photograph.
pub struct Photometric {
    forward: Bound,
    backward: Bound,
}

impl Photometric {
    /// Of the photograph with these pixels.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &PhotometricKernels,
        plan: &wgpu::Buffer,
        frames: &Frames,
        photograph: &wgpu::Buffer,
    ) -> Self {
        let Frames { frame, by_moments, by_pixel, ssim_sums, l1_sums, .. } = frames;
        Self {
            forward: kernels.forward.bind(gpu, &[plan, frame, photograph, by_moments, ssim_sums]),
            backward: kernels.backward.bind(gpu, &[plan, frame, photograph, by_moments, by_pixel, l1_sums]),
        }
    }

    /// The loss and the derivatives by pixels.
    pub fn on(&self, plan: &PlanUniform) -> [Dispatch<'_>; 2] {
        let [across, down] = plan.tiles();
        [&self.forward, &self.backward].map(|kernel| kernel.on(Groups::Box([across, down, 3])))
    }
}
