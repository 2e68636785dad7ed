//! Which pixels of a view are image: one answer from everything that says so, for every stage.
//!
//! Not valid is what an alpha band, a mask in or beside the file (`.msk`) or the user's mask has as 0, what is no finite
//! number, and nodata, as the file or the product's metadata declare it. Of whole numbers a nodata value may be a colour
//! as well, as 0 is in the shadows of an 8-bit image: among the image's other values it is nodata only where it is
//! connected with the border; far from all of them it is nodata everywhere.

use super::View;
use crate::io::{Grid2, ImageFile, RasterError, ValidPixels, Window};

/// Pixels looked at in one go.
const STRIP_PX: usize = 1 << 22;
/// A nodata value this far beyond all other values is none of them, as a share of their range.
const AMONG: f32 = 0.01;
/// Share of an image, in percent, from which a black margin is worth a word.
const WIDE_MARGIN_PERCENT: f64 = 1.0;

impl View {
    /// Which pixels of what is used of the image are image; none if all of them are.
    ///
    /// # Errors
    /// [`RasterError`] when a file cannot be read.
    pub fn valid_pixels(&self) -> Result<Option<ValidPixels>, RasterError> {
        let mask = self.mask.as_deref().map(ImageFile::open).transpose()?;
        valid_pixels(self, &ImageFile::open(&self.image)?, mask.as_ref())
    }

    /// How many percent of the pixels that count as image are 0 in all bands and connected with the border: such margins
    /// are mostly no image, but no file says so. None where they are few.
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

/// As [`View::valid_pixels`], of opened files.
pub(super) fn valid_pixels(
    view: &View,
    file: &ImageFile,
    mask: Option<&ImageFile>,
) -> Result<Option<ValidPixels>, RasterError> {
    let used = view.used_window();
    let about = view.bands.iter().map(|b| file.band(*b)).collect::<Result<Vec<_>, _>>()?;
    let nodata: Vec<Option<f32>> =
        about.iter().map(|b| b.nodata.or(view.nodata).filter(|v| !v.is_nan()).map(|v| v as f32)).collect();
    let is_integer = about.iter().all(|b| b.is_integer);
    let masks = file.masks(&view.bands);
    let has_values_to_test = !is_integer || nodata.iter().any(Option::is_some);
    if masks.is_empty() && mask.is_none() && !has_values_to_test {
        return Ok(None);
    }
    let mut valid = ValidPixels::filled(used.width, used.height, true);
    let mut found = Found::new(used);
    for window in strips(used) {
        let mut hidden = vec![false; window.width * window.height];
        let mut hide = |values: &[f32]| {
            // A mask's own nodata is no image either.
            let zeros = hidden.iter_mut().zip(values).filter(|(_, v)| **v == 0.0 || v.is_nan());
            zeros.for_each(|(hidden, _)| *hidden = true);
        };
        masks.read(window)?.iter().for_each(|m| hide(m));
        if let Some(mask) = mask {
            hide(&mask.read_window(1, window)?.data);
        }
        if has_values_to_test {
            let bands = bands(view, file, window)?;
            for (i, hidden) in hidden.iter_mut().enumerate().filter(|(_, hidden)| !**hidden) {
                *hidden = bands.iter().any(|p| !p.data[i].is_finite());
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

/// Where an image has its nodata value, and what other values it has.
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

    /// Takes a pixel's values with their bands' nodata.
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

/// The bands used, as they are stored.
fn bands(view: &View, file: &ImageFile, window: Window) -> Result<Vec<Grid2>, RasterError> {
    let size = (window.width, window.height);
    view.bands.iter().map(|b| file.read_stored(*b, window, size)).collect()
}

/// Column and row in `used` of the pixel `i` of a window of the whole image.
fn place(i: usize, window: Window, used: Window) -> (usize, usize) {
    (window.col - used.col + i % window.width, window.row - used.row + i / window.width)
}

/// A window in parts of whole rows.
fn strips(used: Window) -> impl Iterator<Item = Window> {
    let rows = (STRIP_PX / used.width.max(1)).max(1);
    let parts = (0..used.height).step_by(rows);
    parts.map(move |row| Window { row: used.row + row, height: rows.min(used.height - row), ..used })
}
