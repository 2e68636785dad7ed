//! Training on a GPU of any vendor, by way of wgpu: Vulkan, Metal and DX12.
//!
//! Whole iterations run on the device: projection, order, tile lists, compositing, loss, gradient and optimiser. [`DevicePhotographs`] and
//! [`DeviceSatellites`] say of which kernels an iteration consists. Kernels are WGSL files, one each, in `wgsl/`; the constants that they share
//! with the processor's code come from there. No sum of floating-point numbers is atomic, so that the same device, driver and seed give
//! the same bytes.

mod anchors;
mod arrays;
mod backend;
mod buffers;
mod camera_kind;
mod constants;
mod device;
mod frames;
mod kernel;
mod photographs;
mod photometric;
mod plan_uniform;
mod raster;
mod satellite_image;
mod satellites;
mod self_test;
mod shader;
mod shading_uniform;
mod sort;
mod splats;
mod submission;
mod views;
#[cfg(test)]
mod backend_tests;
#[cfg(test)]
mod satellite_tests;
#[cfg(test)]
mod tests;

pub use backend::GpuBackend;
pub use device::{DeviceInfo, DeviceKind, GpuDevice, devices};
pub use photographs::DevicePhotographs;
pub use satellites::DeviceSatellites;
pub use submission::Measured;
pub use views::DeviceViews;
