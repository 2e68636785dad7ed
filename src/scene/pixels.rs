//! Pixel values of a view, scaled to [0, 1]; NaN at pixels without valid data.

use super::validity::valid_pixels;
use super::{SceneError, View};
use crate::io::{Grid2, ImageFile, RasterError, ValidPixels, Window};
use crate::stats::quantile;
use std::path::PathBuf;

/// Fraction of the pixels that is clipped at each end when images of more than 8 bits are stretched.
const STRETCH_TAIL: f64 = 0.005;
/// Range of 8-bit values, which are not stretched.
const BYTES: (f32, f32) = (0.0, 255.0);

/// Numbers of windows along each side of an image in which its values are sampled, and longest side of a window in pixels:
/// for the range of values, and for the stretch of an image that is read in parts.
const FEW: (usize, usize) = (4, 64);
const MANY: (usize, usize) = (8, 256);

/// Least number of known ones among the eight neighbours of a missing pixel that is filled: a line of one pixel has six, the corner
/// of a larger hole five.
const SPECK_NEIGHBOURS: usize = 6;

/// Quantile of the values of an image that stands for its shadows.
const SHADOW_QUANTILE: f64 = 0.05;
/// Geometric mean of median and shadows, of 8-bit brightness, above which an image is taken for one with display gamma.
///
/// Most ground reflects less than half of the light, and shadows get less than a third of what sunlit ground gets: in linear
/// images the mean is 30 to 47 (47 simulated scenes, `docs/experiments/shadows.md`). With the display gamma it is above 90
/// (the same scenes encoded; DFC2019's JAX_068 98).
const DISPLAYED: f64 = 70.0;

/// Range of the stored values of an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// Smallest value.
    pub low: f32,
    /// Median value.
    pub median: f32,
    /// Largest value.
    pub high: f32,
}

impl View {
    /// The range of stored values of the selected bands, sampled in windows spread over the image; `None` without valid
    /// values.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn value_range(&self) -> Result<Option<ValueRange>, RasterError> {
        let files = self.open()?;
        let mut values = Vec::new();
        for window in self.samples(FEW) {
            let bands = files.stored(window, (window.width, window.height))?;
            values.extend(bands.iter().flat_map(Grid2::valid).filter(|v| v.is_finite()));
        }
        if values.is_empty() {
            return Ok(None);
        }
        let middle = values.len() / 2;
        let (below, &mut median, above) = values.select_nth_unstable_by(middle, f32::total_cmp);
        let low = below.iter().copied().fold(median, f32::min);
        let high = above.iter().copied().fold(median, f32::max);
        Ok(Some(ValueRange { low, median, high }))
    }

    /// Whether the image is probably encoded with display gamma, which files do not state: it has 8 bits and is bright, its
    /// shadows too. The brightness of a pixel is the mean of its bands. Only samples are read; black pixels, which may be
    /// margins, and those of the declared nodata value do not count.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub(super) fn is_displayed(&self) -> Result<bool, RasterError> {
        let file = ImageFile::open(&self.image)?;
        if file.bit_depth() != 8 {
            return Ok(false);
        }
        let mut brightness = Vec::new();
        for window in self.samples(FEW) {
            let bands = self.bands.iter().map(|b| file.read_window(*b, window));
            let bands = bands.collect::<Result<Vec<_>, _>>()?;
            let mean =
                |i: usize| bands.iter().map(|band| f64::from(band.data[i])).sum::<f64>() / bands.len() as f64;
            brightness.extend((0..window.width * window.height).map(mean).filter(|v| *v > 0.0));
        }
        let at = |share| quantile(brightness.clone(), share);
        let both = at(SHADOW_QUANTILE).zip(at(0.5));
        Ok(both.is_some_and(|(shadows, median)| median * shadows > DISPLAYED * DISPLAYED))
    }

    /// The window of the image that is used.
    pub(super) fn used_window(&self) -> Window {
        self.window.unwrap_or(Window { col: 0, row: 0, width: self.width, height: self.height })
    }

    /// Windows spread over the used part of the image, `count` along each side and at most `side` pixels wide; they cover it
    /// completely if it is small enough.
    fn samples(&self, (count, side): (usize, usize)) -> impl Iterator<Item = Window> {
        let whole = self.used_window();
        let step = (whole.width.div_ceil(count), whole.height.div_ceil(count));
        let corners = (0..count * count).map(move |i| (i % count * step.0, i / count * step.1));
        corners.filter(move |(col, row)| *col < whole.width && *row < whole.height).map(move |(col, row)| {
            let width = step.0.min(whole.width - col).min(side);
            let height = step.1.min(whole.height - row).min(side);
            Window { col: whole.col + col, row: whole.row + row, width, height }
        })
    }

    /// Colours of the view: three bands with values in [0, 1], or one for a panchromatic image, of the size of the view; NaN
    /// at pixels that are not valid ([`View::valid_pixels`]).
    ///
    /// 8-bit values are divided by 255. Values of more bits, and all values if a stretch is requested, are stretched
    /// linearly between two quantiles, which are the same for every band, so that hues are kept.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn read_colors(&self) -> Result<Vec<Grid2>, RasterError> {
        self.colors_at((self.width, self.height))
    }

    /// As [`View::read_colors`], downsampled by averaging until no side is longer than `side` pixels.
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn thumbnail(&self, side: usize) -> Result<Vec<Grid2>, RasterError> {
        let step = (self.width.max(self.height) as f64 / side as f64).max(1.0);
        let scaled = |pixels: usize| ((pixels as f64 / step).round() as usize).max(1);
        self.colors_at((scaled(self.width), scaled(self.height)))
    }

    fn colors_at(&self, size: (usize, usize)) -> Result<Vec<Grid2>, RasterError> {
        let files = self.open()?;
        let mut bands = files.stored(self.used_window(), size)?;
        let range = match (self.stretch, files.tail()?) {
            (Some([low, high]), _) => (low, high),
            (None, Some(tail)) => stretch(bands.iter().flat_map(Grid2::valid), tail),
            (None, None) => BYTES,
        };
        bands.iter_mut().for_each(|raster| scale(raster, range));
        Ok(bands)
    }

    fn open(&self) -> Result<Files<'_>, RasterError> {
        let mask = self.mask.as_deref().map(ImageFile::open).transpose()?;
        let image = ImageFile::open(&self.image)?;
        let valid = valid_pixels(self, &image, mask.as_ref())?;
        Ok(Files { view: self, image, valid })
    }

    /// Sets the mask.
    ///
    /// # Errors
    /// [`SceneError::OtherMask`] if its size is not that of the image, [`SceneError::Image`] if it cannot be opened.
    pub(super) fn set_mask(&mut self, mask: PathBuf) -> Result<(), SceneError> {
        let (width, height) = ImageFile::open(&mask)?.size();
        if (width, height) != (self.width, self.height) {
            let (image, of) = (self.image.clone(), (self.width, self.height));
            return Err(SceneError::OtherMask {
                mask,
                width,
                height,
                image,
                of_width: of.0,
                of_height: of.1,
            });
        }
        self.mask = Some(mask);
        Ok(())
    }

    /// Opens the view as a gray image that is read window by window.
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn gray_image(&self) -> Result<GrayImage<'_>, RasterError> {
        let files = self.open()?;
        let range = match self.stretch {
            Some([low, high]) => (low, high),
            None => files.sampled_range()?.unwrap_or(BYTES),
        };
        Ok(GrayImage { files, range })
    }

    /// The stored values that become 0 and 1, from samples of the used part of the image; `None` for 8-bit images, which
    /// are not stretched.
    ///
    /// Parts of an image have the same brightness only if this range is determined once and set as [`View::stretch`].
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn sampled_stretch(&self) -> Result<Option<[f32; 2]>, RasterError> {
        Ok(self.open()?.sampled_range()?.map(|(low, high)| [low, high]))
    }
}

/// A view as a gray image, the mean of its bands, with values in [0, 1] and NaN at pixels that are not valid. Only the
/// requested windows are in memory.
pub struct GrayImage<'a> {
    files: Files<'a>,
    /// Stored values that become 0 and 1.
    range: (f32, f32),
}

impl GrayImage<'_> {
    /// The valid pixels of the used part of the image; `None` if all are valid.
    #[must_use]
    pub fn valid_pixels(&self) -> Option<&ValidPixels> {
        self.files.valid.as_ref()
    }

    /// Reads a window, in pixels of the used part of the image.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn read(&self, window: Window) -> Result<Grid2, RasterError> {
        let used = self.files.view.used_window();
        let place = Window { col: used.col + window.col, row: used.row + window.row, ..window };
        let mut bands = self.files.stored(place, (window.width, window.height))?;
        bands.iter_mut().for_each(|raster| scale(raster, self.range));
        let n = bands.len() as f32;
        let pixels = 0..window.width * window.height;
        let data = pixels.map(|i| bands.iter().map(|p| p.data[i]).sum::<f32>() / n).collect();
        Ok(Grid2 { width: window.width, height: window.height, data })
    }

    /// As [`GrayImage::read`], with single missing pixels filled from their neighbours.
    ///
    /// # Errors
    /// As [`GrayImage::read`].
    pub fn read_without_specks(&self, window: Window) -> Result<Grid2, RasterError> {
        self.read(window).map(without_specks)
    }
}

/// The image in which single missing pixels are the mean of those around: scattered ones would leave no keypoint, as each
/// needs a whole neighbourhood. Larger holes stay.
fn without_specks(image: Grid2) -> Grid2 {
    if !image.data.iter().any(|v| v.is_nan()) {
        return image;
    }
    let mut filled = image.clone();
    for (i, value) in filled.data.iter_mut().enumerate().filter(|(_, value)| value.is_nan()) {
        let (col, row) = (i % image.width, i / image.width);
        let cols = col.saturating_sub(1)..(col + 2).min(image.width);
        let rows = row.saturating_sub(1)..(row + 2).min(image.height);
        let around = rows.flat_map(|row| cols.clone().map(move |col| (col, row)));
        let known = around.map(|(col, row)| image.at(col, row)).filter(|v| !v.is_nan());
        let (sum, count) = known.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
        if count >= SPECK_NEIGHBOURS {
            *value = sum / count as f32;
        }
    }
    filled
}

/// The opened files of a view.
struct Files<'a> {
    view: &'a View,
    image: ImageFile,
    /// The valid pixels of the used part of the image; `None` if all are valid.
    valid: Option<ValidPixels>,
}

impl Files<'_> {
    /// Stored values of the selected bands in a window of the whole image, resampled to `size`; NaN at pixels that are not
    /// valid.
    fn stored(&self, window: Window, size: (usize, usize)) -> Result<Vec<Grid2>, RasterError> {
        let bands = self.view.bands.iter().map(|b| self.image.read_stored(*b, window, size));
        let mut bands = bands.collect::<Result<Vec<_>, _>>()?;
        if let Some(valid) = &self.valid {
            let used = self.view.used_window();
            let place = Window { col: window.col - used.col, row: window.row - used.row, ..window };
            bands.iter_mut().for_each(|raster| valid.clear(raster, place));
        }
        Ok(bands)
    }

    /// Stored values that become 0 and 1, from samples; `None` for values that are not stretched.
    fn sampled_range(&self) -> Result<Option<(f32, f32)>, RasterError> {
        let Some(tail) = self.tail()? else { return Ok(None) };
        let mut values = Vec::new();
        for window in self.view.samples(MANY) {
            let bands = self.stored(window, (window.width, window.height))?;
            values.extend(bands.iter().flat_map(Grid2::valid));
        }
        Ok(Some(stretch(values.into_iter(), tail)))
    }

    /// Fraction of the values that the stretch clips at each end; `None` for 8-bit values, which are not stretched.
    fn tail(&self) -> Result<Option<f64>, RasterError> {
        let first = self.view.bands.first().copied().unwrap_or_default();
        Ok(match self.view.stretch_percent {
            None if self.image.band(first)?.is_byte => None,
            percent => Some(percent.map_or(STRETCH_TAIL, |p| 0.01 * p)),
        })
    }
}

/// Scales values linearly so that `low` becomes 0 and `high` becomes 1, and clamps them.
fn scale(raster: &mut Grid2, (low, high): (f32, f32)) {
    let scale = 1.0 / (high - low).max(f32::MIN_POSITIVE);
    // Clamping keeps NaN.
    raster.data.iter_mut().for_each(|v| *v = ((*v - low) * scale).clamp(0.0, 1.0));
}

/// The quantiles of the values at `tail` and 1 - `tail`.
fn stretch(values: impl Iterator<Item = f32>, tail: f64) -> (f32, f32) {
    let mut values: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    if values.is_empty() {
        return (0.0, 1.0);
    }
    let last = values.len() - 1;
    let mut rank =
        |share: f64| *values.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp).1;
    (rank(tail), rank(1.0 - tail))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_missing_pixels_are_filled_and_holes_stay() {
        let hole = |col: usize, row: usize| (5..9).contains(&col) && (5..9).contains(&row);
        let is_missing = |col, row| hole(col, row) || (col, row) == (2, 2) || col == 11;
        let image =
            Grid2::from_fn(14, 12, |col, row| if is_missing(col, row) { f32::NAN } else { col as f32 });
        let filled = without_specks(image);
        assert_eq!((filled.at(2, 2), filled.at(11, 6)), (2.0, 11.0));
        for row in 0..12 {
            for col in 0..14 {
                assert_eq!(filled.at(col, row).is_nan(), hole(col, row) || col == 11 && row % 11 == 0);
            }
        }
    }
}
