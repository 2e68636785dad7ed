//! Pixels of a view as the stages want them: numbers in [0, 1], NaN where there is none.

use super::validity::valid_pixels;
use super::{SceneError, View};
use crate::io::{Grid2, ImageFile, RasterError, ValidPixels, Window};
use std::path::PathBuf;

/// Share of pixels left out at each end when images of more than 8 bits are stretched.
const STRETCH_TAIL: f64 = 0.005;
/// The range of 8 bits that are taken as they are.
const BYTES: (f32, f32) = (0.0, 255.0);

/// Windows along each side of an image in which its values are looked at, and the longest side of one: for their range,
/// and for the stretch of an image that is read in parts.
const FEW: (usize, usize) = (4, 64);
const MANY: (usize, usize) = (8, 256);

/// Medians of 8-bit images above this are hardly light, of which sunlit ground reflects less: half of white. DFC2019's
/// colours, made for looking at, have 139 to 165.
const DISPLAYED: f32 = 127.5;

/// What values an image has, as stored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueRange {
    /// The least.
    pub low: f32,
    /// Half of the values lie below.
    pub median: f32,
    /// The greatest.
    pub high: f32,
}

impl ValueRange {
    /// Whether an image of so many bits is as bright as those made for looking at, which hold a root of the light. No
    /// file says so; this is a guess.
    #[must_use]
    pub fn is_displayed(self, bits: u32) -> bool {
        bits == 8 && self.median > DISPLAYED
    }
}

impl View {
    /// The values of the bands used, in windows spread over the image; none without valid ones.
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

    /// The part of the image that is used.
    pub(super) fn used_window(&self) -> Window {
        self.window.unwrap_or(Window { col: 0, row: 0, width: self.width, height: self.height })
    }

    /// Windows spread over what is used of the image, so many along each side: all of it if they are wide enough.
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

    /// The view's colours: three bands in [0, 1], or one for a panchromatic image; NaN where a pixel is not valid
    /// ([`View::valid_pixels`]).
    ///
    /// 8-bit images are divided by 255; others, or all when a stretch is asked for, are stretched linearly between the
    /// values below and above which the tails lie, the same for every band, so that colours keep their hue.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn read_colors(&self) -> Result<Vec<Grid2>, RasterError> {
        self.colors_at((self.width, self.height))
    }

    /// As [`View::read_colors`], averaged down until no side is longer than `side` pixels.
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
        let range = match files.tail()? {
            Some(tail) => stretch(bands.iter().flat_map(Grid2::valid), tail),
            None => BYTES,
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

    /// Takes a mask.
    ///
    /// # Errors
    /// [`SceneError::OtherMask`] when it is of another size than the image, [`SceneError::Image`].
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

    /// The view as a gray image that is read window by window.
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn gray_image(&self) -> Result<GrayImage<'_>, RasterError> {
        let files = self.open()?;
        let Some(tail) = files.tail()? else { return Ok(GrayImage { files, range: BYTES }) };
        let mut values = Vec::new();
        for window in self.samples(MANY) {
            let bands = files.stored(window, (window.width, window.height))?;
            values.extend(bands.iter().flat_map(Grid2::valid));
        }
        Ok(GrayImage { files, range: stretch(values.into_iter(), tail) })
    }
}

/// A view as a gray image, the mean of its bands: values in [0, 1], NaN where there is no image. Only the requested window is
/// in memory.
pub struct GrayImage<'a> {
    files: Files<'a>,
    /// What becomes 0, and what 1.
    range: (f32, f32),
}

impl GrayImage<'_> {
    /// Which pixels of what is used of the image are image; none if all of them are.
    #[must_use]
    pub fn valid_pixels(&self) -> Option<&ValidPixels> {
        self.files.valid.as_ref()
    }

    /// Reads a window of what is used of the image.
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
}

/// A view's opened files.
struct Files<'a> {
    view: &'a View,
    image: ImageFile,
    /// Which pixels of what is used are image, if not all are.
    valid: Option<ValidPixels>,
}

impl Files<'_> {
    /// The bands used as they are stored, of a window of the whole image at another size; NaN where there is no image.
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

    /// Share of the values that a stretch leaves out at each end; none for 8 bits that are taken as they are.
    fn tail(&self) -> Result<Option<f64>, RasterError> {
        let first = self.view.bands.first().copied().unwrap_or_default();
        Ok(match self.view.stretch_percent {
            None if self.image.band(first)?.is_byte => None,
            percent => Some(percent.map_or(STRETCH_TAIL, |p| 0.01 * p)),
        })
    }
}

/// Makes the lower end of a range 0 and the upper 1.
fn scale(raster: &mut Grid2, (low, high): (f32, f32)) {
    let scale = 1.0 / (high - low).max(f32::MIN_POSITIVE);
    // NaN stays NaN through the clamp.
    raster.data.iter_mut().for_each(|v| *v = ((*v - low) * scale).clamp(0.0, 1.0));
}

/// Values below and above which the tails lie.
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
