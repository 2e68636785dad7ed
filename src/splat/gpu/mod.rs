//! Training on a GPU of any vendor, by way of wgpu: Vulkan, Metal and DX12.
//!
//! Whole iterations of photographs with ellipsoids run on the device: projection, depth order, tile lists, compositing, loss,
//! gradient and optimiser. Kernels are WGSL files, one each, in `wgsl/`; the constants that they share with the processor's code
//! come from there. No sum is atomic, so that the same device, driver and seed give the same bytes.

mod arrays;
mod backend;
mod buffers;
mod constants;
mod device;
mod frames;
mod kernel;
mod photographs;
mod photometric;
mod plan_uniform;
mod raster;
mod self_test;
mod shader;
mod sort;
mod splats;
#[cfg(test)]
mod backend_tests;
#[cfg(test)]
mod tests;

pub use arrays::Measured;
pub use backend::GpuBackend;
pub use device::{DeviceInfo, DeviceKind, GpuDevice, devices};
