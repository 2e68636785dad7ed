//! The photographs of a training in the memory of a device.

use super::constants::NO_DATA;
use super::device::GpuDevice;
use crate::splat::backend::GpuError;
use crate::splat::pinhole::PinholeView;

/// A photograph: four bytes of each pixel, red, green and blue on black and the opacity.
pub struct DevicePhotograph {
    /// The pixels, row by row.
    pub pixels: wgpu::Buffer,
    /// Share of the pixels that have data.
    pub valid_share: f64,
}

impl DevicePhotograph {
    /// Copies the photograph of a view.
    pub fn new(gpu: &GpuDevice, view: &PinholeView) -> Result<Self, GpuError> {
        let (width, height) = view.camera.size;
        let places = (0..height).flat_map(|row| (0..width).map(move |col| (col, row)));
        let words: Vec<u32> = places.map(|(col, row)| view.pixel(col, row).map_or(NO_DATA, pack)).collect();
        let valid = words.iter().filter(|word| **word != NO_DATA).count();
        let pixels = gpu.array("photograph", words.len() as u64)?;
        gpu.write(&pixels, &words);
        Ok(Self { pixels, valid_share: valid as f64 / words.len().max(1) as f64 })
    }
}

/// The bytes of a pixel with data.
fn pack(([red, green, blue], opacity): ([u8; 3], u8)) -> u32 {
    let word = u32::from_le_bytes([red, green, blue, opacity]);
    // Colours on black are not white where nothing is; a file that says so differs by one level.
    if word == NO_DATA { word - 1 } else { word }
}
