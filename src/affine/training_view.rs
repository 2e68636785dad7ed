//! Training views: their cameras, pixels and masks.

use super::ViewCamera;
use crate::frame::{CenterPx, Pixel, SiteBox};
use crate::io::{Grid2, ValidPixels};
use crate::scene::TransferFunction;
use crate::stats::quantile;
use rayon::prelude::*;
use std::sync::Arc;

/// Stored colour of pixels that are masked. Unmasked black pixels are stored as the darkest blue.
const MASKED: [u8; 3] = [0; 3];
const BLACK: [u8; 3] = [0, 0, 1];
/// Largest distance between a value of an 8-bit image, times 255, and a whole number.
const WHOLE: f32 = 1e-3;

/// A view that is trained on.
#[derive(Clone, Debug)]
pub struct TrainingView {
    /// Name of the view.
    pub name: String,
    /// The camera in the site frame.
    pub camera: ViewCamera,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Whether the image has a single band, which stands for all colours.
    pub is_gray: bool,
    /// Colours (red, green, blue; 0 to 255) or [`MASKED`], row by row.
    colors: Vec<[u8; 3]>,
    /// Means of the three colours, 0 to 65,535, of an image of more than 8 bits, for matching: the colours of snow and of
    /// shadows differ by less than 1/255.
    fine_gray: Option<Vec<u16>>,
    /// Mask of the valid pixels of the image, if not all are valid. Valid pixels outside of the area are
    /// masked as well.
    valid: Option<Arc<ValidPixels>>,
    /// Shear of the camera towards the sun, pixels per metre of altitude; none if the sun is unknown or too low.
    pub sun_shear: Option<[f64; 2]>,
    /// Relation between stored colours and linear radiance.
    pub transfer_function: TransferFunction,
    /// Linear radiance by stored colour.
    linear: [f32; 256],
}

impl TrainingView {
    /// A view from its bands (red, green and blue, or a single one), in [0, 1] with NaN where the image has
    /// no valid pixel.
    ///
    /// Pixels whose ray leaves `area` (site metres) between the lowest and the highest of `altitudes` are masked.
    #[must_use]
    pub fn new(
        name: String,
        camera: ViewCamera,
        sun_shear: Option<[f64; 2]>,
        bands: &[Grid2],
        area: SiteBox,
        (low, high): (f64, f64),
    ) -> Self {
        let (width, height) = (bands[0].width, bands[0].height);
        let (west, south, east, north) = area;
        let values =
            |i: usize| -> [f32; 3] { std::array::from_fn(|k| bands[k.min(bands.len() - 1)].data[i]) };
        let color = |i: usize| {
            let (col, row) = (i % width, i / width);
            // A ray is straight but for millimetres, and the area is convex.
            let inside = [low, high].into_iter().all(|altitude| {
                let [x, y] = camera.localize(Pixel::new(col as f64, row as f64), altitude);
                x >= west && x <= east && y >= south && y <= north
            });
            let rgb = values(i);
            if !inside || rgb.iter().any(|v| v.is_nan()) {
                return MASKED;
            }
            let stored = rgb.map(|v| (v * 255.0).round() as u8);
            if stored == MASKED { BLACK } else { stored }
        };
        let colors = (0..width * height).into_par_iter().map(color).collect();
        let is_fine = |v: f32| (255.0 * v - (255.0 * v).round()).abs() > WHOLE;
        let fine_gray = bands.iter().any(|band| band.valid().any(is_fine)).then(|| {
            let gray = |i| (values(i).iter().sum::<f32>() / 3.0 * f32::from(u16::MAX)).round() as u16;
            (0..width * height).into_par_iter().map(gray).collect()
        });
        let valid = ValidPixels::of_bands(bands).map(Arc::new);
        let (transfer_function, linear) =
            (TransferFunction::default(), linear_by_color(TransferFunction::default()));
        let is_gray = bands.len() == 1;
        Self {
            name,
            camera,
            width,
            height,
            is_gray,
            colors,
            fine_gray,
            valid,
            sun_shear,
            transfer_function,
            linear,
        }
    }

    /// The view with another relation between stored colours and linear radiance; by default, they are proportional.
    #[must_use]
    pub fn with_transfer_function(self, transfer_function: TransferFunction) -> Self {
        Self { transfer_function, linear: linear_by_color(transfer_function), ..self }
    }

    /// Gray values for matching: the square root of the mean linear radiance of the three colours; NaN where masked.
    ///
    /// The square root increases the contrast in shadows, and makes the variance of photon noise independent
    /// of radiance.
    #[must_use]
    pub fn sqrt_gray(&self) -> Grid2 {
        Grid2::from_fn(self.width, self.height, |col, row| {
            let pixel = row * self.width + col;
            let stored = self.colors[pixel];
            if stored == MASKED {
                return f32::NAN;
            }
            let radiance = match &self.fine_gray {
                Some(gray) => self.transfer_function.linear(f32::from(gray[pixel]) / f32::from(u16::MAX)),
                None => stored.map(|v| self.linear[usize::from(v)]).iter().sum::<f32>() / 3.0,
            };
            radiance.sqrt()
        })
    }

    /// Mask of the valid pixels of the image, inside and outside of the area; none if all are valid.
    #[must_use]
    pub fn valid_pixels(&self) -> Option<&Arc<ValidPixels>> {
        self.valid.as_ref()
    }

    /// Stored colour of the pixel nearest to a position, in [0, 1]; none outside of the image and where masked.
    #[must_use]
    pub fn color(&self, p: Pixel<CenterPx>) -> Option<[f32; 3]> {
        let (col, row) = (p.col.round(), p.row.round());
        let inside = col >= 0.0 && row >= 0.0 && col < self.width as f64 && row < self.height as f64;
        if inside { self.color_at(col as usize, row as usize) } else { None }
    }

    /// Stored colours (red, green, blue; 0 to 255), row by row; zero where masked, and only there.
    #[must_use]
    pub fn stored_colors(&self) -> &[[u8; 3]] {
        &self.colors
    }

    /// Linear radiance of each stored value.
    #[must_use]
    pub fn linear_values(&self) -> &[f32; 256] {
        &self.linear
    }

    fn color_at(&self, col: usize, row: usize) -> Option<[f32; 3]> {
        let stored = self.colors[row * self.width + col];
        (stored != MASKED).then(|| stored.map(|v| f32::from(v) / 255.0))
    }

    /// Mean linear radiance (red, green, blue) of the unmasked pixels of a square block of `side` pixels with
    /// its upper left pixel at (`col`, `row`); none if all are masked. The block must lie within the image.
    #[inline]
    #[must_use]
    pub fn block_mean(&self, col: usize, row: usize, side: usize) -> Option<[f32; 3]> {
        let (mut sum, mut n) = ([0.0; 3], 0u16);
        for r in row..row + side {
            // Masked pixels are black and do not change the sum.
            for stored in &self.colors[r * self.width + col..][..side] {
                n += u16::from(*stored != MASKED);
                for k in 0..3 {
                    sum[k] += self.linear[usize::from(stored[k])];
                }
            }
        }
        let scale = 1.0 / f32::from(n.max(1));
        (n > 0).then(|| sum.map(|s| s * scale))
    }
}

/// Linear radiance of each stored value.
fn linear_by_color(transfer_function: TransferFunction) -> [f32; 256] {
    std::array::from_fn(|v| transfer_function.linear(v as f32 / 255.0))
}

/// Median ground sampling distance of views, metres; NaN without views.
#[must_use]
pub fn median_pixel_m(views: &[TrainingView]) -> f64 {
    quantile(views.iter().map(|v| v.camera.gsd_m()).collect(), 0.5).unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matching_sees_more_than_8_bits_where_the_image_has_them() {
        let camera = ViewCamera::affine([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [0.0, 0.0]);
        let gray = |value: fn(usize) -> f32| {
            let bands = [Grid2::from_fn(8, 1, |col, _| value(col))];
            let area = (-10.0, -10.0, 10.0, 10.0);
            TrainingView::new("v".into(), camera, None, &bands, area, (0.0, 0.0)).sqrt_gray().data
        };
        let fine = gray(|col| 0.5 + 0.0005 * col as f32);
        assert!(fine.iter().enumerate().all(|(col, v)| (v * v - 0.5 - 0.0005 * col as f32).abs() < 1e-4));
        let of_bytes = gray(|col| (100 + col) as f32 / 255.0);
        assert!(
            of_bytes.iter().enumerate().all(|(col, v)| (255.0 * v * v - (100 + col) as f32).abs() < 1e-3)
        );
    }

    #[test]
    fn pixels_whose_ray_leaves_the_area_between_the_altitudes_are_masked() {
        // A pixel is 1 m wide; points move by half a pixel to the left for every metre up, so rays lean east.
        let camera = ViewCamera::affine([[1.0, 0.0, -0.5], [0.0, -1.0, 0.0]], [10.0, 2.0]);
        let bands = [Grid2::filled(21, 5, 0.5)];
        let trained = |altitudes: (f64, f64)| {
            let area = (-10.0, -2.0, 10.0, 2.0);
            let view = TrainingView::new("v".into(), camera, None, &bands, area, altitudes);
            let columns = (0..view.width).filter(|c| view.color(Pixel::new(*c as f64, 2.0)).is_some());
            columns.collect::<Vec<_>>()
        };
        assert_eq!(trained((0.0, 0.0)), (0..21).collect::<Vec<_>>());
        assert_eq!(trained((0.0, 8.0)), (0..17).collect::<Vec<_>>());
        assert_eq!(trained((-4.0, 8.0)), (2..17).collect::<Vec<_>>());
    }
}
