//! Colour images in memory that are written as PNG.

use super::{WriteError, write_png_rgb};
use std::path::Path;

/// An image of red, green and blue bytes, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Three bytes for each pixel.
    pub data: Vec<u8>,
}

impl RgbImage {
    /// A white image.
    #[must_use]
    pub fn white(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![255; 3 * width * height] }
    }

    /// Colour of a pixel; panics outside of the image.
    #[must_use]
    pub fn at(&self, col: usize, row: usize) -> [u8; 3] {
        let i = 3 * (row * self.width + col);
        [self.data[i], self.data[i + 1], self.data[i + 2]]
    }

    /// Sets the colour of a pixel; panics outside of the image.
    pub fn set(&mut self, col: usize, row: usize, color: [u8; 3]) {
        let i = 3 * (row * self.width + col);
        self.data[i..i + 3].copy_from_slice(&color);
    }

    /// Writes the image as PNG.
    ///
    /// # Errors
    /// [`WriteError`].
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_png_rgb(path, self.width, self.height, &self.data)
    }
}
