//! The valid pixels of a view, from all sources, for all stages.
//!
//! A pixel is not valid if it is 0 in an alpha band, in a mask in or beside the file (`.msk`) or in the mask of the user, if
//! its value is no measurement ([`is_measurement`]), or if it is nodata as the file or the metadata of the product declare it.
//! In images of whole numbers a nodata value may occur as a colour too, as 0 in the shadows of an 8-bit image: if it lies
//! within the range of the other values, it is nodata only where it is connected with the border, otherwise everywhere.

use super::View;
use crate::io::{Grid2, ImageFile, RasterError, ValidPixels, Window, is_measurement};

/// Number of pixels that are read at a time.
const STRIP_PX: usize = 1 << 22;
/// Side of the parts of a large view whose valid pixels are digested, pixels.
const PART_PX: usize = 8192;
/// Distance of a nodata value from the range of the other values, as a fraction of that range, from which on it does not
/// occur as a colour.
const AMONG: f32 = 0.01;
/// Smallest black margin that gives a warning, percent of the image.
const WIDE_MARGIN_PERCENT: f64 = 1.0;

impl View {
    /// The valid pixels of the used part of the image; `None` if all are valid.
    ///
    /// # Errors
    /// [`RasterError`] when a file cannot be read.
    pub fn valid_pixels(&self) -> Result<Option<ValidPixels>, RasterError> {
        let mask = self.mask.as_deref().map(ImageFile::open).transpose()?;
        valid_pixels(self, &ImageFile::open(&self.image)?, mask.as_ref())
    }

    /// A digest of the valid pixels; `None` if all are valid. That of a large view is made of those of its parts, so that
    /// no mask of all of it is in memory.
    ///
    /// # Errors
    /// As [`View::valid_pixels`].
    pub fn valid_pixels_digest(&self) -> Result<Option<String>, RasterError> {
        if self.width * self.height <= PART_PX * PART_PX {
            return Ok(self.valid_pixels()?.map(|valid| valid.digest()));
        }
        let (mut hasher, mut all_valid) = (blake3::Hasher::new(), true);
        for row in (0..self.height).step_by(PART_PX) {
            for col in (0..self.width).step_by(PART_PX) {
                let (width, height) = (PART_PX.min(self.width - col), PART_PX.min(self.height - row));
                let part = self.cropped(Window { col, row, width, height }).valid_pixels()?;
                all_valid &= part.is_none();
                hasher.update(part.map_or_else(|| "valid".into(), |p| p.digest()).as_bytes());
            }
        }
        Ok((!all_valid).then(|| hasher.finalize().to_hex().to_string()))
    }

    /// Percentage of the valid pixels that are 0 in all bands and connected with the border. They are probably a margin
    /// without data that no file declares. `None` if there are only few.
    ///
    /// # Errors
    /// As [`View::valid_pixels`].
    pub fn undeclared_margin_percent(&self) -> Result<Option<f64>, RasterError> {
        let file = ImageFile::open(&self.image)?;
        let used = self.used_window();
        let valid = self.valid_pixels()?;
        let mut black = ValidPixels::filled(used.width, used.height, false);
        let mut margin = 0;
        for window in strips(used) {
            let bands = bands(self, &file, window)?;
            for i in (0..window.width * window.height).filter(|i| bands.iter().all(|p| p.data[*i] == 0.0)) {
                let (col, row) = place(i, window, used);
                black.set(col, row, valid.as_ref().is_none_or(|v| v.at(col, row)));
                margin += 1;
            }
        }
        if margin == 0 {
            return Ok(None);
        }
        let all = valid.map_or(used.width * used.height, |v| v.count()).max(1);
        let percent = 100.0 * black.connected_with_border().count() as f64 / all as f64;
        Ok((percent >= WIDE_MARGIN_PERCENT).then_some(percent))
    }
}

/// The same as [`View::valid_pixels`], for opened files.
pub(super) fn valid_pixels(
    view: &View,
    file: &ImageFile,
    mask: Option<&ImageFile>,
) -> Result<Option<ValidPixels>, RasterError> {
    let used = view.used_window();
    let about = view.bands.iter().map(|b| file.band(*b)).collect::<Result<Vec<_>, _>>()?;
    let nodata: Vec<Option<f32>> =
        about.iter().map(|b| b.nodata.or(view.nodata).filter(|v| !v.is_nan()).map(|v| v as f32)).collect();
    let is_integer = about.iter().all(|b| b.kind.is_integer());
    let masks = file.masks(&view.bands);
    let has_values_to_test = !is_integer || nodata.iter().any(Option::is_some);
    if masks.is_empty() && mask.is_none() && !has_values_to_test {
        return Ok(None);
    }
    let mut valid = ValidPixels::filled(used.width, used.height, true);
    let mut found = Found::new(used);
    for window in strips(used) {
        let mut hidden = vec![false; window.width * window.height];
        for values in masks.read(window)? {
            hidden.iter_mut().zip(values).for_each(|(hidden, value)| *hidden |= value == 0.0);
        }
        if let Some(mask) = mask {
            let marked = mask.marked(window)?;
            hidden.iter_mut().zip(marked).for_each(|(hidden, is_marked)| *hidden |= !is_marked);
        }
        if has_values_to_test {
            let bands = bands(view, file, window)?;
            for (i, hidden) in hidden.iter_mut().enumerate().filter(|(_, hidden)| !**hidden) {
                *hidden = bands.iter().any(|p| !is_measurement(p.data[i]));
                if !*hidden {
                    let (col, row) = place(i, window, used);
                    found.look(bands.iter().map(|p| p.data[i]).zip(nodata.iter().copied()), col, row);
                }
            }
        }
        for (i, _) in hidden.iter().enumerate().filter(|(_, hidden)| **hidden) {
            let (col, row) = place(i, window, used);
            valid.set(col, row, false);
        }
    }
    let first = nodata.iter().flatten().next().copied();
    if let Some(nodata) = first.filter(|_| found.any) {
        let is_color = is_integer && found.is_among_others(nodata);
        let missing = if is_color { found.all_bands.connected_with_border() } else { found.some_band };
        for row in 0..used.height {
            (0..used.width).filter(|col| missing.at(*col, row)).for_each(|col| valid.set(col, row, false));
        }
    }
    Ok((valid.count() < used.width * used.height).then_some(valid))
}

/// The pixels with the nodata value, and the range of the other values.
struct Found {
    some_band: ValidPixels,
    all_bands: ValidPixels,
    any: bool,
    others: (f32, f32),
}

impl Found {
    fn new(used: Window) -> Self {
        let nowhere = ValidPixels::filled(used.width, used.height, false);
        Self {
            some_band: nowhere.clone(),
            all_bands: nowhere,
            any: false,
            others: (f32::INFINITY, f32::NEG_INFINITY),
        }
    }

    /// Adds a pixel: the values of its bands, each with the nodata value of its band.
    fn look(&mut self, values: impl Iterator<Item = (f32, Option<f32>)>, col: usize, row: usize) {
        let (mut some, mut all) = (false, true);
        for (value, nodata) in values {
            let is_nodata = nodata == Some(value);
            (some, all) = (some || is_nodata, all && is_nodata);
            if !is_nodata {
                self.others = (self.others.0.min(value), self.others.1.max(value));
            }
        }
        if some {
            self.any = true;
            self.some_band.set(col, row, true);
            self.all_bands.set(col, row, all);
        }
    }

    fn is_among_others(&self, nodata: f32) -> bool {
        let (low, high) = self.others;
        let near = (AMONG * (high - low)).max(1.0);
        nodata >= low - near && nodata <= high + near
    }
}

/// Stored values of the selected bands.
fn bands(view: &View, file: &ImageFile, window: Window) -> Result<Vec<Grid2>, RasterError> {
    let size = (window.width, window.height);
    view.bands.iter().map(|b| file.read_stored(*b, window, size)).collect()
}

/// Column and row, in the window `used`, of the pixel with index `i` in a window of the whole image.
fn place(i: usize, window: Window, used: Window) -> (usize, usize) {
    (window.col - used.col + i % window.width, window.row - used.row + i / window.width)
}

/// Divides a window into parts of whole rows.
fn strips(used: Window) -> impl Iterator<Item = Window> {
    let rows = (STRIP_PX / used.width.max(1)).max(1);
    let parts = (0..used.height).step_by(rows);
    parts.map(move |row| Window { row: used.row + row, height: rows.min(used.height - row), ..used })
}
