//! Cost of reading windows of images, and the refusal of images whose windows cannot be read alone.
//!
//! A file is read in whole blocks. Tiles hold little beside a window; strips of whole rows of a wide image hold many times
//! as much.

use super::{SceneError, View};
use crate::io::{ImageFile, RasterError, Window, vsi};
use std::collections::BTreeMap;
use std::path::Path;

/// Width of an image, in pixels, up to which it may be striped.
const WIDE_PX: usize = 20_000;
/// Largest ratio of the bytes read to the bytes of the windows in a striped image.
const MOST_FOLD: u64 = 8;
/// Bytes read beside the windows, in all striped images together, up to which they are accepted.
const MOST_WASTE: u64 = 1_000_000_000;

/// What reading a window of an image costs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadCost {
    /// Bytes of the pixels of the window, decoded; of all bands if the file stores them together.
    pub window_bytes: u64,
    /// Bytes of the blocks that the window touches, decoded.
    pub block_bytes: u64,
    /// Bytes of these blocks in the file, estimated from the size of the whole file.
    pub stored_bytes: u64,
}

impl View {
    /// The cost of reading the view's bands in a window of its whole image. Masks are not counted. Only the header of the
    /// image is read.
    ///
    /// # Errors
    /// [`RasterError`] if the image cannot be opened, or does not have the bands of the view.
    pub fn read_cost(&self, window: Window) -> Result<ReadCost, RasterError> {
        ReadCost::of(&ImageFile::open(&self.image)?, &self.bands, window)
    }
}

impl ReadCost {
    /// The cost of reading bands in a window of an image that is open.
    ///
    /// # Errors
    /// [`RasterError`] if the image does not have the bands.
    pub fn of(file: &ImageFile, bands: &[usize], window: Window) -> Result<Self, RasterError> {
        let blocks = file.blocks(bands.first().copied().unwrap_or(1))?;
        let read = if blocks.holds_all_bands { 1 } else { bands.len() as u64 };
        let pixel = read * blocks.pixel_bytes as u64;
        let ((width, height), block_bytes) = (file.size(), pixel * blocks.touched_px(window));
        let groups = if blocks.holds_all_bands { 1 } else { file.bands() };
        let decoded = (width as u64 * height as u64 * groups as u64 * blocks.pixel_bytes as u64).max(1);
        // The size of a virtual raster says nothing about its sources.
        let stored = match vsi::size(file.path()) {
            Ok(size) if size < decoded && super::sources_of(file.path()).is_empty() => size,
            _ => decoded,
        };
        Ok(Self {
            window_bytes: pixel * window.width as u64 * window.height as u64,
            block_bytes,
            stored_bytes: (block_bytes as f64 * (stored as f64 / decoded as f64)).ceil() as u64,
        })
    }
}

/// Refuses images of more than 20,000 columns that are stored as strips of whole rows, if reading some windows of them one
/// after the other, each from its view's whole image, would read more than 8 times the bytes of the windows, and more than
/// 1 GB beside them.
///
/// # Errors
/// [`SceneError::Striped`] names the image with the largest waste; [`SceneError::Image`] if an image cannot be opened.
pub fn require_tiled_images<'a>(
    reads: impl IntoIterator<Item = (&'a View, Window)>,
) -> Result<(), SceneError> {
    let mut windows_of = BTreeMap::<&Path, (&View, Vec<Window>)>::new();
    for (view, window) in reads {
        windows_of.entry(&view.image).or_insert_with(|| (view, Vec::new())).1.push(window);
    }
    let mut striped = Vec::new();
    for (image, (view, windows)) in windows_of {
        // The width of a view that is not cropped is that of its image, which then need not be opened.
        if view.window.is_none() && view.width <= WIDE_PX {
            continue;
        }
        let file = ImageFile::open(image)?;
        let width = file.size().0;
        let blocks = file.blocks(view.bands.first().copied().unwrap_or(1))?;
        if width <= WIDE_PX || blocks.width < width {
            continue;
        }
        let (mut needed, mut read) = (0, 0);
        for window in windows {
            let cost = ReadCost::of(&file, &view.bands, window)?;
            (needed, read) = (needed + cost.window_bytes, read + cost.block_bytes);
        }
        if read > MOST_FOLD * needed {
            striped.push((read - needed, read, needed, image));
        }
    }
    let waste: u64 = striped.iter().map(|s| s.0).sum();
    match striped.iter().max() {
        Some((_, read, needed, image)) if waste > MOST_WASTE => Err(SceneError::Striped {
            image: (*image).into(),
            read_gb: *read as f64 / 1e9,
            needed_gb: *needed as f64 / 1e9,
            others: striped.len() - 1,
        }),
        _ => Ok(()),
    }
}
