//! Colour images in memory that are written as PNG.

use super::{WriteError, write_png_rgb};
use std::path::Path;

/// An image of red, green and blue bytes, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbImage {
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Red, green and blue of each pixel, row by row: `3 * width * height` bytes.
    pub data: Vec<u8>,
}

/// Gap between panels, pixels.
const GAP: usize = 8;

impl RgbImage {
    /// The colour that pictures give pixels without data.
    pub const NO_DATA: [u8; 3] = [160, 160, 160];

    /// `N` panels of a size (columns, rows) side by side; `colors` gives the colours of a pixel (column, row) in all of them.
    #[must_use]
    pub fn panels<const N: usize>(
        (width, height): (usize, usize),
        colors: impl Fn(usize, usize) -> [[u8; 3]; N],
    ) -> Self {
        let mut out = Self::white((N * (width + GAP)).saturating_sub(GAP), height);
        for row in 0..height {
            for col in 0..width {
                for (panel, color) in colors(col, row).into_iter().enumerate() {
                    out.set(panel * (width + GAP) + col, row, color);
                }
            }
        }
        out
    }

    /// A white image.
    #[must_use]
    pub fn white(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![255; 3 * width * height] }
    }

    /// Red, green and blue of a pixel.
    ///
    /// # Panics
    /// Panics if the pixel is outside of the image.
    #[must_use]
    pub fn at(&self, col: usize, row: usize) -> [u8; 3] {
        let i = 3 * (row * self.width + col);
        [self.data[i], self.data[i + 1], self.data[i + 2]]
    }

    /// Sets red, green and blue of a pixel.
    ///
    /// # Panics
    /// Panics if the pixel is outside of the image.
    pub fn set(&mut self, col: usize, row: usize, color: [u8; 3]) {
        let i = 3 * (row * self.width + col);
        self.data[i..i + 3].copy_from_slice(&color);
    }

    /// Writes the image as PNG.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        write_png_rgb(path, self.width, self.height, &self.data)
    }
}
