//! The arrays of images on a device: what a view's render, its loss and their gradients need for each pixel and tile.

use super::device::GpuDevice;
use crate::splat::backend::GpuError;

/// Arrays with room for the pixels and tiles of the largest view.
pub struct Frames {
    /// Colour and transmittance of each pixel.
    pub frame: wgpu::Buffer,
    /// Derivatives of the loss by red, green and blue, plane by plane.
    pub by_pixel: wgpu::Buffer,
    /// Derivatives by the blurred moments of SSIM: three planes of each colour.
    pub by_moments: wgpu::Buffer,
    /// First pair of each tile's list, the first behind it, and the number of useful ones.
    pub ranges: wgpu::Buffer,
    /// Sums of SSIM over tiles, colour by colour.
    pub ssim_sums: wgpu::Buffer,
    /// Sums of absolute differences over tiles, colour by colour.
    pub l1_sums: wgpu::Buffer,
}

impl Frames {
    /// Room for so many pixels and tiles.
    pub fn new(gpu: &GpuDevice, pixels: u64, tiles: u64) -> Result<Self, GpuError> {
        Ok(Self {
            frame: gpu.array("pixels", 4 * pixels)?,
            by_pixel: gpu.array("derivatives by pixels", 3 * pixels)?,
            by_moments: gpu.array("derivatives by moments", 9 * pixels)?,
            ranges: gpu.array("ranges of tiles", 4 * tiles)?,
            ssim_sums: gpu.array("sums of SSIM", 3 * tiles)?,
            l1_sums: gpu.array("sums of differences", 3 * tiles)?,
        })
    }
}
