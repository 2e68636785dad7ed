//! Pixels of a view as the stages want them: numbers in [0, 1], NaN where there is none.

use super::{SceneError, View};
use crate::raster::{ImageFile, Plane, RasterError, Window};
use std::path::PathBuf;

/// Share of pixels left out at each end when images of more than 8 bits are stretched.
const STRETCH_TAIL: f64 = 0.005;

/// Windows along each side of an image in which its values are looked at, and the longest side of one.
const SAMPLES: usize = 4;
const SAMPLE_PX: usize = 64;

impl View {
    /// Least and greatest value of the bands used, as stored, in windows spread over the image; none without valid ones.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn value_range(&self) -> Result<Option<(f32, f32)>, RasterError> {
        let file = ImageFile::open(&self.image)?;
        let whole = self.used_window();
        let step = (whole.width.div_ceil(SAMPLES), whole.height.div_ceil(SAMPLES));
        let mut range = None;
        for (col, row) in (0..SAMPLES * SAMPLES).map(|i| (i % SAMPLES * step.0, i / SAMPLES * step.1)) {
            if col >= whole.width || row >= whole.height {
                continue;
            }
            let width = step.0.min(whole.width - col).min(SAMPLE_PX);
            let height = step.1.min(whole.height - row).min(SAMPLE_PX);
            let window = Window { col: whole.col + col, row: whole.row + row, width, height };
            for band in &self.bands {
                for v in file.read_window(*band, window)?.valid().filter(|v| v.is_finite()) {
                    let (low, high) = range.get_or_insert((v, v));
                    (*low, *high) = (low.min(v), high.max(v));
                }
            }
        }
        Ok(range)
    }

    /// The part of the image that is used.
    fn used_window(&self) -> Window {
        self.window.unwrap_or(Window { col: 0, row: 0, width: self.width, height: self.height })
    }

    /// The view's colours: three planes in [0, 1], or one for a panchromatic image; NaN where the mask is 0.
    ///
    /// 8-bit images are divided by 255; others, or all when a stretch is asked for, are stretched linearly between the
    /// values below and above which the tails lie, the same for every band, so that colours keep their hue.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn read_colors(&self) -> Result<Vec<Plane>, RasterError> {
        self.colors_at((self.width, self.height))
    }

    /// As [`View::read_colors`], averaged down until no side is longer than `side` pixels.
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn thumbnail(&self, side: usize) -> Result<Vec<Plane>, RasterError> {
        let step = (self.width.max(self.height) as f64 / side as f64).max(1.0);
        let scaled = |pixels: usize| ((pixels as f64 / step).round() as usize).max(1);
        self.colors_at((scaled(self.width), scaled(self.height)))
    }

    fn colors_at(&self, size: (usize, usize)) -> Result<Vec<Plane>, RasterError> {
        let file = ImageFile::open(&self.image)?;
        let window = self.used_window();
        let planes = self.bands.iter().map(|b| file.read_scaled(*b, window, size));
        let mut planes = planes.collect::<Result<Vec<_>, _>>()?;
        if let Some(mask) = &self.mask {
            let mask = ImageFile::open(mask)?.read_scaled(1, window, size)?;
            for plane in &mut planes {
                for (v, m) in plane.data.iter_mut().zip(&mask.data) {
                    // The mask's own nodata is no image either.
                    if *m == 0.0 || m.is_nan() {
                        *v = f32::NAN;
                    }
                }
            }
        }
        let is_byte = file.band(self.bands.first().copied().unwrap_or_default())?.is_byte;
        let (lo, hi) = match self.stretch_percent {
            None if is_byte => (0.0, 255.0),
            percent => stretch(&planes, percent.map_or(STRETCH_TAIL, |p| 0.01 * p)),
        };
        let scale = 1.0 / (hi - lo).max(f32::MIN_POSITIVE);
        for v in planes.iter_mut().flat_map(|p| &mut p.data) {
            // NaN stays NaN through the clamp.
            *v = ((*v - lo) * scale).clamp(0.0, 1.0);
        }
        Ok(planes)
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

    /// The view's brightness: the mean of its colours.
    ///
    /// # Errors
    /// As [`View::read_colors`].
    pub fn read_gray(&self) -> Result<Plane, RasterError> {
        let planes = self.read_colors()?;
        let n = planes.len() as f32;
        let (width, height) = (planes[0].width, planes[0].height);
        let data = (0..width * height).map(|i| planes.iter().map(|p| p.data[i]).sum::<f32>() / n).collect();
        Ok(Plane { width, height, data })
    }
}

/// Values below and above which the tails lie.
fn stretch(planes: &[Plane], tail: f64) -> (f32, f32) {
    let mut values: Vec<f32> = planes.iter().flat_map(Plane::valid).filter(|v| v.is_finite()).collect();
    if values.is_empty() {
        return (0.0, 1.0);
    }
    let last = values.len() - 1;
    let mut rank =
        |share: f64| *values.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp).1;
    (rank(tail), rank(1.0 - tail))
}
