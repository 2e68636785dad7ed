//! Normal consistency of discs on a device.

use super::device::GpuDevice;
use super::frames::ImageArrays;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::plan_uniform::PlanUniform;
use super::shader;
use crate::splat::backend::GpuError;

/// The compiled kernels, and the sums of differences over tiles.
pub struct NormalKernels {
    compare: Kernel,
    report: Kernel,
    sums: wgpu::Buffer,
}

/// The comparison of an image's normals.
pub struct Normals {
    compare: Bound,
    report: Bound,
}

impl NormalKernels {
    /// Compiles them, for images of so many tiles.
    pub fn new(gpu: &GpuDevice, tiles: u64) -> Result<Self, GpuError> {
        Ok(Self {
            compare: Kernel::new(gpu, shader::NORMAL_CONSISTENCY, &[]),
            report: Kernel::new(gpu, shader::REPORT_NORMALS, &[]),
            sums: gpu.array("sums of normals", tiles)?,
        })
    }

    /// The kernels with an image and the words of the report.
    pub fn bind(
        &self,
        gpu: &GpuDevice,
        plan: &wgpu::Buffer,
        image: &ImageArrays,
        report: &wgpu::Buffer,
    ) -> Normals {
        let Self { compare, report: of_report, sums } = self;
        Normals {
            compare: compare.bind(gpu, &[plan, &image.frame, &image.by_pixel, sums]),
            report: of_report.bind(gpu, &[plan, sums, report]),
        }
    }
}

impl Normals {
    /// The comparison with its derivatives, and its report, which comes after that of all sums.
    pub fn on(&self, plan: &PlanUniform) -> [Dispatch<'_>; 2] {
        let [across, down] = plan.tiles();
        [self.compare.on(Groups::Box([across, down, 1])), self.report.on(Groups::Row(1))]
    }
}
