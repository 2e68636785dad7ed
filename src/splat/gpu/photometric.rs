//! The photometric loss on a device.

use super::camera_kind::CameraKind;
use super::device::GpuDevice;
use super::frames::LossArrays;
use super::kernel::{Bound, Dispatch, Groups, Kernel};
use super::plan_uniform::PlanUniform;
use super::shader;

/// The compiled kernels.
pub struct PhotometricKernels {
    forward: Kernel,
    backward: Kernel,
}

impl PhotometricKernels {
    /// Compiles them for views of this kind: photographs are stored as bytes, and what satellite views are compared with as linear
    /// colours.
    pub fn new(gpu: &GpuDevice, kind: CameraKind) -> Self {
        let [forward, backward] = match kind {
            CameraKind::Pinhole => [shader::SSIM_FORWARD_PHOTOGRAPH, shader::SSIM_BACKWARD_PHOTOGRAPH],
            CameraKind::Parallel => [shader::SSIM_FORWARD_LINEAR, shader::SSIM_BACKWARD_LINEAR],
        }
        .map(|shader| Kernel::new(gpu, shader, &[]));
        Self { forward, backward }
    }
}

/// The loss of one picture.
pub struct Photometric {
    forward: Bound,
    backward: Bound,
}

impl Photometric {
    /// Of a picture that is compared with a target; the derivatives go to `by_pixel`.
    pub fn new(
        gpu: &GpuDevice,
        kernels: &PhotometricKernels,
        plan: &wgpu::Buffer,
        [picture, target, by_pixel]: [&wgpu::Buffer; 3],
        arrays: &LossArrays,
    ) -> Self {
        let LossArrays { by_moments, ssim_sums, l1_sums } = arrays;
        Self {
            forward: kernels.forward.bind(gpu, &[plan, picture, target, by_moments, ssim_sums]),
            backward: kernels.backward.bind(gpu, &[plan, picture, target, by_moments, by_pixel, l1_sums]),
        }
    }

    /// The loss and the derivatives by pixels.
    pub fn on(&self, plan: &PlanUniform) -> [Dispatch<'_>; 2] {
        let [across, down] = plan.tiles();
        [&self.forward, &self.backward].map(|kernel| kernel.on(Groups::Box([across, down, 3])))
    }
}
