//! PSNR and SSIM of a rendered picture against the image of a view that was not trained on.

use crate::io::Grid2;
use crate::nn::lpips::{Lpips, LpipsError, PlanarRgb};
use crate::splat::loss::photometric::Photometric;
use crate::splat::loss::target::TargetImage;
use crate::splat::raster::Image;
use nalgebra::{Matrix4, Vector4};
use serde::Serialize;
use std::ops::Range;

/// Similarity of a picture to an image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PictureScore {
    /// Peak signal-to-noise ratio, dB, of colours in [0, 1].
    pub psnr_db: f64,
    /// Mean structural similarity (11 x 11 Gaussian window of σ = 1.5 px).
    pub ssim: f64,
    /// The same with a window of 3 x 3 pixels, as publications on satellite images have it.
    pub ssim_3px: f64,
    /// The value that the program of Sat-NeRF prints as SSIM: `ssim_3px` of the colours one after the other, row by row and pixel
    /// by pixel, taken for three planes. It mixes pixels and colours, and compares with publications that used that program alone.
    pub ssim_sat_nerf: f64,
    /// Perceptual distance (LPIPS), if a network was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lpips: Option<f64>,
    /// Number of scored pixels.
    pub pixels: usize,
}

/// Which part of an image is scored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScoredPart {
    /// The whole image.
    Whole,
    /// The right half; the left half may have been used to choose the colours of the picture.
    RightHalf,
}

impl ScoredPart {
    /// The columns of the part in an image of this width.
    #[must_use]
    pub fn columns(self, width: usize) -> Range<usize> {
        match self {
            Self::Whole => 0..width,
            Self::RightHalf => width / 2..width,
        }
    }
}

/// The pixels of a picture and of an image that are compared: zero in both where the image has no data.
pub struct ScoredPair {
    /// The picture, values in [0, 1].
    pub picture: Image<f32>,
    /// The image.
    pub image: Image<f32>,
    /// Number of pixels with data.
    pub pixels: usize,
}

impl ScoredPair {
    /// The columns of two images of the same height. `at` gives the colours of picture and image at a column and row; none
    /// where the image has no data.
    fn new(
        columns: Range<usize>,
        height: usize,
        at: impl Fn(usize, usize) -> Option<([f32; 3], [f32; 3])>,
    ) -> Self {
        let zeros = || Image::zeros(columns.len(), height, 3);
        let mut pair = Self { picture: zeros(), image: zeros(), pixels: 0 };
        for (col, row) in (0..height).flat_map(|row| columns.clone().map(move |col| (col, row))) {
            let Some((found, expected)) = at(col, row) else { continue };
            pair.pixels += 1;
            for k in 0..3 {
                *pair.picture.at_mut(k, col - columns.start, row) = found[k].clamp(0.0, 1.0);
                *pair.image.at_mut(k, col - columns.start, row) = expected[k];
            }
        }
        pair
    }

    /// A part of a picture (red, green, blue) and of an image of the same size.
    #[must_use]
    pub fn of_view(colors: &[Grid2; 3], target: &TargetImage, part: ScoredPart) -> Self {
        let Image { width, height, .. } = target.colors;
        Self::new(part.columns(width), height, |col, row| {
            let expected = || std::array::from_fn(|k| target.colors.at(k, col, row));
            target.valid[row * width + col].then(|| (colors.each_ref().map(|c| c.at(col, row)), expected()))
        })
    }

    /// The perceptual distance of the two (LPIPS).
    fn lpips(&self, network: &Lpips<f32>) -> Result<f64, LpipsError> {
        let planes = [&self.picture, &self.image].map(|image| [0, 1, 2].map(|c| image.plane(c).data));
        let (width, height) = (self.image.width, self.image.height);
        let [picture, image] = planes
            .each_ref()
            .map(|planes| PlanarRgb::new(width, height, planes.each_ref().map(|plane| &plane[..])));
        network.distance(picture?, image?)
    }

    /// The scores, with the perceptual distance if there is a network; none if no pixel has data.
    ///
    /// # Errors
    /// [`LpipsError`] if the images are too small for the network.
    pub fn score_with(&self, network: Option<&Lpips<f32>>) -> Result<Option<PictureScore>, LpipsError> {
        let Some(score) = self.score() else { return Ok(None) };
        Ok(Some(PictureScore { lpips: network.map(|n| self.lpips(n)).transpose()?, ..score }))
    }

    /// The scores; none if no pixel has data.
    #[must_use]
    pub fn score(&self) -> Option<PictureScore> {
        if self.pixels == 0 {
            return None;
        }
        let differences = self.picture.data.iter().zip(&self.image.data);
        let squares: f64 = differences.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        let (similarity, _) = Photometric::default().compare(&self.picture, &self.image);
        // Pixels without data are zero in both images, and there SSIM is 1.
        let all = (self.image.width * self.image.height) as f64;
        let pixels = self.pixels as f64;
        let of_data = |ssim: f64| (ssim * all - (all - pixels)) / pixels;
        Some(PictureScore {
            psnr_db: -10.0 * (squares / (3.0 * pixels)).log10(),
            ssim: of_data(similarity.ssim),
            ssim_3px: of_data(ssim_3px(&self.picture, &self.image)),
            ssim_sat_nerf: of_data(ssim_3px(&rows_as_planes(&self.picture), &rows_as_planes(&self.image))),
            lpips: None,
            pixels: self.pixels,
        })
    }
}

/// Mean SSIM over pixels and channels with a Gaussian window of 3 x 3 pixels and σ = 1.5 px; pixels beyond the border repeat
/// those at it.
fn ssim_3px(picture: &Image<f32>, image: &Image<f32>) -> f64 {
    const C1: f64 = 1e-4;
    const C2: f64 = 9e-4;
    let side = (-1.0 / (2.0 * 1.5f64.powi(2))).exp();
    let taps = [side, 1.0, side].map(|t| t / (1.0 + 2.0 * side));
    let (width, height) = (image.width, image.height);
    let mut sum = 0.0;
    for (k, row, col) in
        (0..3 * height).flat_map(|kr| (0..width).map(move |col| (kr / height, kr % height, col)))
    {
        let mut moments = [0.0; 5];
        for (j, i) in (0..9).map(|t| (t / 3, t % 3)) {
            let c = (col + i).saturating_sub(1).min(width - 1);
            let r = (row + j).saturating_sub(1).min(height - 1);
            let (x, y) = (f64::from(picture.at(k, c, r)), f64::from(image.at(k, c, r)));
            let weight = taps[i] * taps[j];
            for (moment, value) in moments.iter_mut().zip([x, y, x * x, y * y, x * y]) {
                *moment += weight * value;
            }
        }
        let [x, y, xx, yy, xy] = moments;
        let (of_x, of_y, covariance) = (xx - x * x, yy - y * y, xy - x * y);
        sum += (2.0 * x * y + C1) * (2.0 * covariance + C2) / ((x * x + y * y + C1) * (of_x + of_y + C2));
    }
    sum / (3 * width * height) as f64
}

/// The image that has the colours of one of three planes in the order of its pixels, each with its red, green and blue, where it
/// should have the planes: Sat-NeRF's program (arXiv 2203.08896) views an array of (H W, 3) values as (1, 3, H, W).
fn rows_as_planes(image: &Image<f32>) -> Image<f32> {
    let (width, height) = (image.width, image.height);
    let mut out = Image::zeros(width, height, 3);
    let pixels = (0..height).flat_map(|row| (0..width).map(move |col| (col, row)));
    let values = pixels.flat_map(|(col, row)| (0..3).map(move |k| image.at(k, col, row)));
    for (place, value) in values.enumerate() {
        let (k, rest) = (place / (width * height), place % (width * height));
        *out.at_mut(k, rest % width, rest / width) = value;
    }
    out
}

/// The right half of a picture (red, green, blue) and of an image of the same size, after an affine map of colours that is
/// fitted on the left half: for pictures whose colours were not made for the view. None if the left half of the image has too
/// few valid pixels.
#[must_use]
pub fn fitted_pair(colors: &[Grid2; 3], target: &TargetImage) -> Option<ScoredPair> {
    let (width, height) = (target.colors.width, target.colors.height);
    let color = |col: usize, row: usize| colors.each_ref().map(|c| f64::from(c.at(col, row)));
    let is_valid = |col: usize, row: usize| target.valid[row * width + col];

    let mut normal = Matrix4::zeros();
    let mut right = [Vector4::zeros(); 3];
    for (col, row) in
        (0..height).flat_map(|r| (0..width / 2).map(move |c| (c, r))).filter(|(c, r)| is_valid(*c, *r))
    {
        let [r, g, b] = color(col, row);
        let unknowns = Vector4::new(r, g, b, 1.0);
        normal += unknowns * unknowns.transpose();
        for (k, sum) in right.iter_mut().enumerate() {
            *sum += unknowns * f64::from(target.colors.at(k, col, row));
        }
    }
    let factor = normal.cholesky()?;
    let color_map = right.map(|b| factor.solve(&b));

    let columns = ScoredPart::RightHalf.columns(width);
    Some(ScoredPair::new(columns, height, |col, row| {
        let [r, g, b] = color(col, row);
        let found = color_map.map(|map_row| map_row.dot(&Vector4::new(r, g, b, 1.0)) as f32);
        let expected = || std::array::from_fn(|k| target.colors.at(k, col, row));
        is_valid(col, row).then(|| (found, expected()))
    }))
}

/// A picture and a photograph of the same size, both as displayed, 0 to 1: all pixels that have data, without a change of
/// colours (3DGS).
#[must_use]
pub fn photograph_pair(colors: &[Grid2; 3], truth: &[Grid2; 3]) -> ScoredPair {
    let (width, height) = (truth[0].width, truth[0].height);
    ScoredPair::new(0..width, height, |col, row| {
        let expected = truth.each_ref().map(|plane| plane.at(col, row));
        let has_data = expected.iter().all(|v| !v.is_nan());
        has_data.then(|| (colors.each_ref().map(|c| c.at(col, row)), expected))
    })
}

/// Peak signal-to-noise ratio, dB, of the pixels with data that `keep` chooses by their index; none without pixels.
#[must_use]
pub fn psnr_db_where(colors: &[Grid2; 3], truth: &[Grid2; 3], keep: impl Fn(usize) -> bool) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for i in (0..truth[0].data.len()).filter(|i| keep(*i)) {
        let square = |k: usize| f64::from(colors[k].data[i].clamp(0.0, 1.0) - truth[k].data[i]).powi(2);
        let square = (0..3).map(square).sum::<f64>();
        if square.is_finite() {
            (sum, count) = (sum + square, count + 3.0);
        }
    }
    (count > 0.0).then(|| -10.0 * (sum / f64::max(count, 1.0)).max(1e-12).log10())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texture(col: usize, row: usize, k: usize) -> f32 {
        0.5 + 0.3 * ((col as f32 * 0.7 + k as f32).sin() * (row as f32 * 0.4).cos())
    }

    fn target(of: impl Fn(usize, usize, usize) -> f32) -> TargetImage {
        let mut colors = Image::zeros(80, 60, 3);
        for (col, row, k) in (0..80 * 60 * 3).map(|i| (i % 80, i / 80 % 60, i / 4800)) {
            *colors.at_mut(k, col, row) = of(col, row, k);
        }
        TargetImage { colors, valid: vec![true; 80 * 60] }
    }

    #[test]
    fn an_affine_change_of_colours_costs_nothing_and_noise_has_the_expected_psnr() {
        let picture: [Grid2; 3] = std::array::from_fn(|k| Grid2::from_fn(80, 60, |c, r| texture(c, r, k)));
        let dimmed = target(|c, r, k| 0.1 + 0.6 * texture(c, r, k));
        let score = fitted_pair(&picture, &dimmed).and_then(|p| p.score()).unwrap();
        assert!(score.psnr_db > 90.0 && score.ssim > 0.9999 && score.ssim_3px > 0.9999, "{score:?}");
        assert_eq!(score.pixels, 40 * 60);
        let sign = |c: usize, r: usize| if (c * 7 + r * 13).is_multiple_of(2) { 1.0 } else { -1.0 };
        let noisy = target(|c, r, k| texture(c, r, k) + 0.05 * sign(c, r));
        let score = fitted_pair(&picture, &noisy).and_then(|p| p.score()).unwrap();
        assert!((score.psnr_db - 26.02).abs() < 0.1 && score.ssim < 0.97, "{score:?}");
        assert!(score.ssim_3px < 0.97, "{score:?}");
    }

    #[test]
    fn the_score_of_sat_nerf_is_that_of_pixels_taken_for_planes() {
        let image = target(|c, r, k| (10_000 * k + 100 * r + c) as f32).colors;
        let mixed = rows_as_planes(&image);
        // 4,800 pixels of three colours: the second plane begins with pixel 1,600, the 20 rows and 0 columns below the first.
        assert_eq!([0, 1, 2, 3].map(|c| mixed.at(0, c, 0)), [0.0, 10_000.0, 20_000.0, 1.0]);
        assert_eq!([0, 1].map(|c| mixed.at(1, c, 0)), [2000.0, 12_000.0]);
        assert_eq!(mixed.at(2, 79, 59), 25_979.0);
    }

    #[test]
    fn photographs_are_scored_whole_and_without_a_change_of_colours() {
        let picture: [Grid2; 3] = std::array::from_fn(|k| Grid2::from_fn(80, 60, |c, r| texture(c, r, k)));
        let mut truth = picture.clone();
        truth.iter_mut().flat_map(|c| &mut c.data).for_each(|v| *v += 0.1);
        truth[1].data[7] = f32::NAN;
        let score = photograph_pair(&picture, &truth).score().unwrap();
        assert!((score.psnr_db - 20.0).abs() < 1e-3 && score.ssim < 1.0, "{score:?}");
        assert_eq!(score.pixels, 80 * 60 - 1);
        truth[0].data.fill(f32::NAN);
        assert!(photograph_pair(&picture, &truth).score().is_none());
    }

    #[test]
    fn invalid_pixels_are_not_scored() {
        let picture: [Grid2; 3] = std::array::from_fn(|k| Grid2::from_fn(80, 60, |c, r| texture(c, r, k)));
        let mut masked = target(texture);
        for i in (0..80 * 60).filter(|i| i % 80 > 60) {
            masked.valid[i] = false;
            (0..3).for_each(|k| *masked.colors.at_mut(k, i % 80, i / 80) = 0.0);
        }
        let score = fitted_pair(&picture, &masked).and_then(|p| p.score()).unwrap();
        assert!(score.psnr_db > 90.0 && score.ssim > 0.99 && score.pixels == 21 * 60, "{score:?}");
    }
}
