//! A view as it is matched: its gray values and its camera.

use crate::affine::{TrainingView, ViewCamera};
use crate::frame::{CenterPx, Pixel, Point, Site};
use crate::io::{Grid2, ValidPixels, Window};
use crate::perspective::PinholeCamera;
use std::sync::Arc;

/// A camera that knows the pixels of its image.
pub(super) trait PixelCamera: Copy + Sync {
    /// The camera of a window of the image.
    fn cropped(&self, part: Window) -> Self;

    /// The camera of the image whose pixels are squares of `factor` pixels a side.
    fn reduced(&self, factor: usize) -> Self;
}

/// A camera whose maps hold a value for each pixel that says where the surface lies on its ray.
pub(super) trait RayCamera: PixelCamera {
    /// The point at a value on the ray of a pixel.
    fn point(&self, px: Pixel<CenterPx>, value: f64) -> Point<Site>;

    /// Where the camera sees a point, and the value of the point there; none if it lies behind the camera.
    fn sees(&self, p: Point<Site>) -> Option<(Pixel<CenterPx>, f64)>;
}

impl PixelCamera for ViewCamera {
    fn cropped(&self, part: Window) -> Self {
        Self::cropped(self, part.col as f64, part.row as f64)
    }

    fn reduced(&self, factor: usize) -> Self {
        self.rescaled((factor as f64).recip())
    }
}

/// Values are altitudes, site metres.
impl RayCamera for ViewCamera {
    fn point(&self, px: Pixel<CenterPx>, value: f64) -> Point<Site> {
        let [x, y] = self.localize(px, value);
        Point::new(x, y, value)
    }

    fn sees(&self, p: Point<Site>) -> Option<(Pixel<CenterPx>, f64)> {
        Some((self.project(p), p.z()))
    }
}

impl PixelCamera for PinholeCamera {
    fn cropped(&self, part: Window) -> Self {
        Self::cropped(self, (part.col, part.row), (part.width, part.height))
    }

    fn reduced(&self, factor: usize) -> Self {
        Self::reduced(self, factor)
    }
}

/// Values are inverse depths along the optical axis.
impl RayCamera for PinholeCamera {
    fn point(&self, px: Pixel<CenterPx>, value: f64) -> Point<Site> {
        let [x, y, z] = self.at_depth(px, value.recip());
        Point::new(x, y, z)
    }

    fn sees(&self, p: Point<Site>) -> Option<(Pixel<CenterPx>, f64)> {
        Some((self.project(p)?, self.depth(p).recip()))
    }
}

/// The gray values of a view, with its camera.
#[derive(Clone, Debug)]
pub(super) struct MatchImage<C = ViewCamera> {
    /// Square root of linear radiance ([`TrainingView::sqrt_gray`]), of photographs the values as displayed; NaN where the image has
    /// no valid pixel.
    pub gray: Grid2,
    /// Mask of the valid pixels; none if all pixels are valid, or if the NaN in `gray` say which are.
    valid: Option<Arc<ValidPixels>>,
    pub camera: C,
    /// Mean of the gray values of the whole image.
    pub mean: f64,
    /// Standard deviation of the gray values of the whole image.
    pub std_dev: f64,
}

impl<C: PixelCamera> MatchImage<C> {
    /// An image whose gray values are NaN where it has no valid pixel.
    pub fn of_gray(gray: Grid2, camera: C) -> Self {
        let mean_of = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / f64::max(n, 1.0)
        };
        let mean = mean_of(&mut gray.valid().map(f64::from));
        let variance = mean_of(&mut gray.valid().map(|v| (f64::from(v) - mean).powi(2)));
        Self { camera, mean, std_dev: variance.sqrt(), gray, valid: None }
    }

    /// A window of the image with its camera. Mean and standard deviation remain those of the whole image.
    pub fn cropped(&self, part: Window) -> Self {
        let camera = self.camera.cropped(part);
        Self { gray: self.gray.window(part), valid: None, camera, ..*self }
    }

    /// The image reduced by a whole factor, with its camera: means over blocks of pixels; NaN where half of a block is not
    /// valid.
    pub fn reduced(&self, factor: usize) -> Self {
        let (width, height) = ((self.gray.width / factor).max(1), (self.gray.height / factor).max(1));
        let gray = Grid2::from_rows(width, height, |row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let (mut sum, mut n) = (0.0f32, 0);
                for r in (row * factor..(row + 1) * factor).take_while(|r| *r < self.gray.height) {
                    let columns = col * factor..((col + 1) * factor).min(self.gray.width);
                    for v in self.gray.row(r)[columns].iter().filter(|v| !v.is_nan()) {
                        (sum, n) = (sum + v, n + 1);
                    }
                }
                *out = if 2 * n > factor * factor { sum / n as f32 } else { f32::NAN };
            }
        });
        Self { camera: self.camera.reduced(factor), gray, valid: None, ..*self }
    }
}

impl MatchImage {
    pub fn new(view: &TrainingView) -> Self {
        let valid = view.valid_pixels().cloned();
        Self { valid, ..Self::of_gray(view.sqrt_gray(), view.camera) }
    }

    /// What a pixel shows that lies at an altitude, site metres.
    pub fn point(&self, pixel: usize, altitude: f32) -> Point<Site> {
        let px = Pixel::new((pixel % self.gray.width) as f64, (pixel / self.gray.width) as f64);
        self.camera.point(px, f64::from(altitude))
    }

    /// Gray value at the projection of a point, bilinear, in standard deviations above the mean of the image;
    /// NaN outside.
    pub fn normalized_gray(&self, p: Point<Site>) -> f32 {
        let px = self.camera.project(p);
        ((f64::from(self.gray.bilinear(px.col, px.row)) - self.mean) / self.std_dev) as f32
    }

    /// Whether a point projects into the image, onto valid pixels.
    pub fn covers(&self, p: Point<Site>) -> bool {
        let px = self.camera.project(p);
        if let Some(valid) = &self.valid {
            return valid.surround(px);
        }
        let within = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        within(px.col, self.gray.width) && within(px.row, self.gray.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mvs::tests::{texture, view};

    #[test]
    fn a_reduced_image_holds_means_and_its_camera_sees_the_same_place() {
        let image = MatchImage::new(&view([0.2, 0.0], texture));
        let reduced = image.reduced(4);
        assert_eq!((reduced.gray.width, reduced.gray.height), (40, 35));
        let block = (68..72).flat_map(|row| (80..84).map(move |col| (col, row)));
        let mean = block.map(|(col, row)| image.gray.at(col, row)).sum::<f32>() / 16.0;
        assert!((reduced.gray.at(20, 17) - mean).abs() < 1e-6);
        let p = Point::new(3.0, -4.0, 5.0);
        let (fine, coarse) = (image.camera.project(p), reduced.camera.project(p));
        assert!((fine.col + 0.5 - 4.0 * (coarse.col + 0.5)).abs() < 1e-9);
    }
}
