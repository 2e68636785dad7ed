//! Pixels of a view as the stages want them: numbers in [0, 1], NaN where there is none.

use super::View;
use crate::raster::{ImageFile, Plane, RasterError};

/// Share of pixels left out at each end when images of more than 8 bits are stretched.
const STRETCH_TAIL: f64 = 0.005;

impl View {
    /// The view's colours: three planes in [0, 1], or one for a panchromatic image.
    ///
    /// 8-bit images are divided by 255; others are stretched linearly between their 0.5 % and 99.5 % values,
    /// the same for every band, so that colours keep their hue.
    ///
    /// # Errors
    /// [`RasterError`] when the file cannot be read.
    pub fn read_colors(&self) -> Result<Vec<Plane>, RasterError> {
        let file = ImageFile::open(&self.image)?;
        let count = if file.bands() >= 3 { 3 } else { 1 };
        let mut planes = (1..=count).map(|b| file.read(b)).collect::<Result<Vec<_>, _>>()?;
        let (lo, hi) = if file.band(1)?.is_byte { (0.0, 255.0) } else { stretch(&planes) };
        let scale = 1.0 / (hi - lo).max(f32::MIN_POSITIVE);
        for v in planes.iter_mut().flat_map(|p| &mut p.data) {
            // NaN stays NaN through the clamp.
            *v = ((*v - lo) * scale).clamp(0.0, 1.0);
        }
        Ok(planes)
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
fn stretch(planes: &[Plane]) -> (f32, f32) {
    let mut values: Vec<f32> = planes.iter().flat_map(Plane::valid).filter(|v| v.is_finite()).collect();
    if values.is_empty() {
        return (0.0, 1.0);
    }
    let last = values.len() - 1;
    let mut rank =
        |share: f64| *values.select_nth_unstable_by((share * last as f64) as usize, f32::total_cmp).1;
    (rank(STRETCH_TAIL), rank(1.0 - STRETCH_TAIL))
}
