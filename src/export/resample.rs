//! The image of a view, resampled for a pinhole camera.

use super::ImageMap;
use crate::frame::{CenterPx, Pixel};
use crate::io::{Grid2, RgbImage};
use rayon::prelude::*;

/// A resampled image.
#[derive(Clone, Debug, PartialEq)]
pub struct Resampled {
    /// Colours; black where the view has no data.
    pub colors: RgbImage,
    /// 255 where the view has data, 0 elsewhere, row by row; none if it has data everywhere.
    pub mask: Option<Vec<u8>>,
}

impl Resampled {
    /// Resamples bands (red, green and blue, or a single one) with values from 0 to 1 and NaN where there are no data, by
    /// cubic convolution.
    ///
    /// # Panics
    /// Panics without bands.
    #[must_use]
    pub fn new(bands: &[Grid2], map: &ImageMap, size: (usize, usize)) -> Self {
        Self::of(size, |col, row| {
            let from = map.original_from_resampled(Pixel::new(col as f64, row as f64));
            std::array::from_fn(|k| cubic(&bands[k.min(bands.len() - 1)], from))
        })
    }

    /// The image as it is.
    #[must_use]
    pub fn unchanged(bands: &[Grid2; 3]) -> Self {
        let [first, ..] = bands;
        Self::of((first.width, first.height), |col, row| bands.each_ref().map(|band| band.at(col, row)))
    }

    fn of((width, height): (usize, usize), color: impl Fn(usize, usize) -> [f32; 3] + Sync) -> Self {
        let mut colors = RgbImage::white(width, height);
        let mut mask = vec![255; width * height];
        let rows = colors.data.par_chunks_mut(3 * width).zip(mask.par_chunks_mut(width)).enumerate();
        rows.for_each(|(row, (line, valid))| {
            for (col, (pixel, valid)) in line.chunks_exact_mut(3).zip(valid).enumerate() {
                let rgb = color(col, row);
                let has_data = rgb.iter().all(|v| !v.is_nan());
                *valid = if has_data { 255 } else { 0 };
                for (byte, value) in pixel.iter_mut().zip(rgb) {
                    // NaN becomes 0.
                    *byte = (value.clamp(0.0, 1.0) * 255.0).round() as u8;
                }
            }
        });
        let mask = mask.contains(&0).then_some(mask);
        Self { colors, mask }
    }
}

/// Value at a position by cubic convolution (Keys 1981, a = -1/2), which is exact for polynomials of degree 2; bilinear
/// beside pixels without data. NaN outside of the image.
fn cubic(band: &Grid2, px: Pixel<CenterPx>) -> f32 {
    let (col, row) = (px.col.floor(), px.row.floor());
    let weights = |t: f64| {
        [
            ((-0.5 * t + 1.0) * t - 0.5) * t,
            (1.5 * t - 2.5) * t * t + 1.0,
            ((-1.5 * t + 2.0) * t + 0.5) * t,
            (0.5 * t - 0.5) * t * t,
        ]
    };
    let (across, down) = (weights(px.col - col), weights(px.row - row));
    let mut sum = 0.0;
    for (dr, wr) in (-1..).zip(down) {
        for (dc, wc) in (-1..).zip(across) {
            sum += wr * wc * f64::from(band.get(col as i64 + dc, row as i64 + dr));
        }
    }
    if sum.is_nan() { nearest_bilinear(band, px) } else { sum as f32 }
}

/// Bilinear value; the outer half of a pixel at the border of the image has the value of the border.
fn nearest_bilinear(band: &Grid2, px: Pixel<CenterPx>) -> f32 {
    let (last_col, last_row) = (band.width as f64 - 1.0, band.height as f64 - 1.0);
    let inside = px.col >= -0.5 && px.row >= -0.5 && px.col <= last_col + 0.5 && px.row <= last_row + 0.5;
    if !inside {
        return f32::NAN;
    }
    // Positions at the centre of a pixel but for rounding need no other pixel, which may be without data.
    let snapped = |v: f64| if (v - v.round()).abs() < 1e-6 { v.round() } else { v };
    band.bilinear(snapped(px.col).clamp(0.0, last_col), snapped(px.row).clamp(0.0, last_row))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shift(by: f64) -> ImageMap {
        let nodes = (0..16).map(|i| Pixel::new(f64::from(i % 4) * 3.0, f64::from(i / 4) * 3.0));
        let pairs: Vec<_> = nodes.map(|p| (p, Pixel::new(p.col + by, p.row))).collect();
        ImageMap::fit(&pairs, (10, 10)).unwrap()
    }

    #[test]
    fn cubic_convolution_is_exact_on_a_parabola() {
        let band = Grid2::from_fn(12, 12, |c, r| 0.005 * (c * c) as f32 + 0.02 * r as f32);
        for (col, row) in [(4.0, 5.0), (4.25, 5.5), (7.9, 3.1)] {
            let expected = 0.005 * col * col + 0.02 * row;
            assert!((f64::from(cubic(&band, Pixel::new(col, row))) - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn pixels_without_data_are_black_and_masked() {
        let mut band = Grid2::filled(12, 12, 0.5);
        band.data[5 * 12 + 7] = f32::NAN;
        let Resampled { colors, mask } = Resampled::new(std::slice::from_ref(&band), &shift(1.0), (10, 10));
        let mask = mask.unwrap();
        assert_eq!(mask.iter().filter(|v| **v == 0).count(), 1);
        assert_eq!((mask[5 * 10 + 6], colors.at(6, 5)), (0, [0; 3]));
        assert_eq!(colors.at(5, 5), [128; 3]);
        let outside = Resampled::new(&[band], &shift(4.0), (10, 10)).mask.unwrap();
        assert_eq!([outside[7], outside[8]], [255, 0]);
    }

    #[test]
    fn an_image_with_data_everywhere_has_no_mask() {
        let bands = [0.0, 0.5, 1.0].map(|v| Grid2::filled(10, 10, v));
        for resampled in [Resampled::new(&bands, &shift(0.25), (10, 10)), Resampled::unchanged(&bands)] {
            assert_eq!(resampled.mask, None);
            assert_eq!(resampled.colors.at(9, 9), [0, 128, 255]);
        }
    }
}
