//! The arrays of images on a device: what renders, their losses and the gradients need for each pixel and tile.

use super::camera_kind::CameraKind;
use super::device::GpuDevice;
use crate::splat::backend::GpuError;
use crate::splat::raster::TILE;

/// Numbers of pixels and of tiles.
#[derive(Clone, Copy, Debug, Default)]
pub struct Extent {
    /// Pixels.
    pub pixels: u64,
    /// Tiles.
    pub tiles: u64,
}

impl Extent {
    /// The largest of images with these columns and rows.
    pub fn largest(sizes: impl Iterator<Item = (usize, usize)>) -> Self {
        let of = |(width, height): (usize, usize)| Self {
            pixels: (width * height) as u64,
            tiles: (width.div_ceil(TILE) * height.div_ceil(TILE)) as u64,
        };
        sizes.map(of).fold(Self::default(), |a, b| Self {
            pixels: a.pixels.max(b.pixels),
            tiles: a.tiles.max(b.tiles),
        })
    }
}

/// A rendered image.
#[derive(Debug)]
pub struct ImageArrays {
    /// Each pixel: `pixel_of` in `wgsl/color.wgsl` or `wgsl/color_altitude.wgsl`.
    pub frame: wgpu::Buffer,
    /// Derivatives of the loss by the features, plane by plane.
    pub by_pixel: wgpu::Buffer,
    /// First pair of each tile's list, the first behind it, and the number of useful ones.
    pub ranges: wgpu::Buffer,
}

impl ImageArrays {
    /// Room for an image of this extent.
    pub fn new(gpu: &GpuDevice, kind: CameraKind, extent: Extent) -> Result<Self, GpuError> {
        let Extent { pixels, tiles } = extent;
        Ok(Self {
            frame: gpu.array("pixels", 4 * pixels)?,
            by_pixel: gpu.array("derivatives by pixels", kind.features() * pixels)?,
            ranges: gpu.array("ranges of tiles", 4 * tiles)?,
        })
    }
}

/// What the photometric loss writes.
#[derive(Debug)]
pub struct LossArrays {
    /// Derivatives by the blurred moments of SSIM: three planes of each colour.
    pub by_moments: wgpu::Buffer,
    /// Sums of SSIM over tiles, colour by colour.
    pub ssim_sums: wgpu::Buffer,
    /// Sums of absolute differences over tiles, colour by colour.
    pub l1_sums: wgpu::Buffer,
}

impl LossArrays {
    /// Room for an image of this extent.
    pub fn new(gpu: &GpuDevice, extent: Extent) -> Result<Self, GpuError> {
        let Extent { pixels, tiles } = extent;
        Ok(Self {
            by_moments: gpu.array("derivatives by moments", 9 * pixels)?,
            ssim_sums: gpu.array("sums of SSIM", 3 * tiles)?,
            l1_sums: gpu.array("sums of differences", 3 * tiles)?,
        })
    }
}
