//! Blocks in which a raster file stores its pixels: tiles, or strips of whole rows.

use super::{ImageFile, RasterError, Window};

/// How a band of a raster is divided into blocks, which can only be read whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Columns of a block.
    pub width: usize,
    /// Rows of a block.
    pub height: usize,
    /// Bytes of a pixel of a block, decoded; of all bands if they are stored together.
    pub pixel_bytes: usize,
    /// Whether a block holds the pixels of all bands.
    pub holds_all_bands: bool,
}

impl Blocks {
    /// Number of pixels of the blocks that a window of the raster touches.
    #[must_use]
    pub fn touched_px(&self, window: Window) -> u64 {
        let span = |from: usize, size: usize, block: usize| {
            let block = block.max(1);
            if size == 0 { 0 } else { ((from + size - 1) / block - from / block + 1) as u64 * block as u64 }
        };
        span(window.col, window.width, self.width) * span(window.row, window.height, self.height)
    }
}

impl ImageFile {
    /// The blocks of a band, counted from 1.
    ///
    /// # Errors
    /// [`RasterError::NoBand`] if there is no such band.
    pub fn blocks(&self, index: usize) -> Result<Blocks, RasterError> {
        let band = self.dataset.rasterband(index).map_err(|_| self.no_band(index))?;
        let holds_all_bands = self.metadata("INTERLEAVE", "IMAGE_STRUCTURE").as_deref() == Some("PIXEL");
        let (width, height) = band.block_size();
        let bands = if holds_all_bands { self.bands() } else { 1 };
        let pixel_bytes = bands * usize::from(band.band_type().bits()).div_ceil(8);
        Ok(Blocks { width, height, pixel_bytes, holds_all_bands })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_touches_whole_blocks() {
        let window = Window { col: 300, row: 250, width: 100, height: 20 };
        let strips = Blocks { width: 40_000, height: 1, pixel_bytes: 1, holds_all_bands: true };
        assert_eq!(strips.touched_px(window), 20 * 40_000);
        let tiles = Blocks { width: 256, height: 256, ..strips };
        assert_eq!(tiles.touched_px(window), 2 * 256 * 256);
        assert_eq!(tiles.touched_px(Window { col: 0, row: 0, width: 256, height: 256 }), 256 * 256);
        assert_eq!(tiles.touched_px(Window { width: 0, ..window }), 0);
    }
}
